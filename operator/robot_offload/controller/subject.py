"""The RobotOffload of one pass, as the cluster has it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from robot_offload.kube.port import Manifest


@dataclass(frozen=True, slots=True)
class Subject:
    """The object of a pass.

    Attributes:
        raw: as the API server has it.
    """

    raw: Manifest

    @property
    def namespace(self) -> str:
        """Return its namespace."""
        return str(self.raw["metadata"]["namespace"])

    @property
    def name(self) -> str:
        """Return its name."""
        return str(self.raw["metadata"]["name"])

    @property
    def uid(self) -> str:
        """Return its uid."""
        return str(self.raw["metadata"]["uid"])

    @property
    def generation(self) -> int:
        """Return the generation of its specification."""
        return int(self.raw["metadata"].get("generation") or 0)

    @property
    def status(self) -> Mapping[str, Any]:
        """Return its status as it was last written."""
        return dict(self.raw.get("status") or {})

    @property
    def words(self) -> dict[str, str]:
        """Return its names for log lines."""
        return {"namespace": self.namespace, "name": self.name}

    def annotation(self, key: str) -> str:
        """Return the text of an annotation; empty: it is missing."""
        return str((self.raw["metadata"].get("annotations") or {}).get(key, ""))
