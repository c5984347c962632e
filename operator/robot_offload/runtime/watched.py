"""The watched kinds, and which of their objects. The table is read by kopf's settings and by the recount."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from robot_offload.kube.kinds import CHILD_KINDS, CONFIG_MAP, POD, ROBOT_OFFLOAD, Kind
from robot_offload.kube.port import Manifest, Selection
from robot_offload.objects import labels

OURS: Final = f"{labels.MANAGED_BY}={labels.MANAGER}"


@dataclass(frozen=True, slots=True)
class Watched:
    """A watched kind of object.

    Attributes:
        kind: the kind.
        labels: a label selector; empty: all.
        fields: a field selector; empty: all.
    """

    kind: Kind
    labels: str = OURS
    fields: str = ""

    @property
    def metadata(self) -> Selection:
        """Return the selection for a list of the metadata alone."""
        return Selection(self.labels, self.fields, metadata_only=True)


WATCHED: Final = (
    Watched(ROBOT_OFFLOAD, labels=""),
    *(Watched(kind) for kind in (*CHILD_KINDS, POD) if kind != CONFIG_MAP),
    # Nodes may read users' ConfigMaps. The API server puts one of its own into each namespace.
    Watched(CONFIG_MAP, labels="", fields="metadata.name!=kube-root-ca.crt"),
)
"""Everything that leads to passes."""


def ours(manifest: Manifest) -> bool:
    """Return whether this operator created an object."""
    return (manifest["metadata"].get("labels") or {}).get(labels.MANAGED_BY) == labels.MANAGER
