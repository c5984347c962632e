"""What is watched: each kind, and which of its objects. The table is read by kopf's settings and by the recount."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from robot_offload.kube.kinds import CHILD_KINDS, CONFIG_MAP, POD, ROBOT_OFFLOAD, Kind
from robot_offload.kube.port import Manifest, Selection
from robot_offload.objects import labels

OURS: Final = f"{labels.MANAGED_BY}={labels.MANAGER}"


@dataclass(frozen=True, slots=True)
class Watched:
    """One kind of object.

    Attributes:
        kind: which one.
        labels: a label selector; empty: all.
        fields: a field selector; empty: all.
    """

    kind: Kind
    labels: str = OURS
    fields: str = ""

    @property
    def metadata(self) -> Selection:
        """Return what a list of the metadata alone selects."""
        return Selection(self.labels, self.fields, metadata_only=True)


WATCHED: Final = (
    Watched(ROBOT_OFFLOAD, labels=""),
    *(Watched(kind) for kind in (*CHILD_KINDS, POD) if kind != CONFIG_MAP),
    # Nodes may read ConfigMaps of users. Each namespace has one of the API server's.
    Watched(CONFIG_MAP, labels="", fields="metadata.name!=kube-root-ca.crt"),
)
"""Everything that leads to passes."""


def ours(manifest: Manifest) -> bool:
    """Return whether this operator has made an object."""
    return (manifest["metadata"].get("labels") or {}).get(labels.MANAGED_BY) == labels.MANAGER
