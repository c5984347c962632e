"""Which kind of cluster the stories run on: one of kind if Docker answers, otherwise one of our own."""

from __future__ import annotations

import os
from dataclasses import dataclass

from robot_offload_lab.cluster import kind_cluster, preflight, programs
from robot_offload_lab.cluster.any_cluster import AnyCluster
from robot_offload_lab.cluster.cluster import Cluster
from robot_offload_lab.cluster.errors import ClusterError
from robot_offload_lab.cluster.kind_cluster import KindCluster
from robot_offload_lab.cluster.programs import Say

CHOSEN = "ROBOT_OFFLOAD_E2E_CLUSTER"
"""Environment variable: own, kind or auto."""


@dataclass(frozen=True, slots=True)
class Choice:
    """A kind of cluster.

    Attributes:
        kind: Whether it is one of kind, not one of our own.
        why: Why it was chosen.
        missing: Why it cannot run here, and the next step; None when it can.
    """

    kind: bool
    why: str
    missing: str | None

    def __str__(self) -> str:
        return f"cluster: {'of kind' if self.kind else 'our own'}, because {self.why}"

    def prepare(self, say: Say) -> None:
        """Build the programs that it needs."""
        if self.kind:
            kind_cluster.prepare(say)
        else:
            programs.everything(say)

    def up(self, *, nodes: int, say: Say) -> AnyCluster:
        """Start one and return when its nodes and its DNS are ready."""
        say(str(self))
        if self.kind:
            return KindCluster.up(nodes=nodes, say=say)
        return Cluster.up(nodes=nodes, say=say)


def choose() -> Choice:
    """Return the kind that the environment asks for, or one that this machine can run.

    Raises:
        ClusterError: The environment asks for something else.
    """
    wanted = os.environ.get(CHOSEN, "") or "auto"
    match wanted:
        case "own":
            return Choice(False, f"{CHOSEN}={wanted}", preflight.preflight())
        case "kind":
            return Choice(True, f"{CHOSEN}={wanted}", kind_cluster.missing())
        case "auto":
            if why := kind_cluster.missing():
                return Choice(False, f"kind cannot be used: {why.partition(' Next:')[0]}", preflight.preflight())
            return Choice(True, "Docker answers", None)
    raise ClusterError(f"{CHOSEN}={wanted}: use own, kind or auto")
