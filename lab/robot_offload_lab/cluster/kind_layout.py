"""Names and addresses of a cluster whose nodes are containers of Docker: those of a layout, and Docker's."""

from __future__ import annotations

from dataclasses import dataclass

from robot_offload_lab.cluster.layout import Layout

MOST_NODES = 4
"""Beside the control plane: so many addresses of nodes Docker may give away."""


@dataclass(frozen=True, slots=True)
class KindLayout(Layout):
    """What is where when kind makes the nodes.

    Addresses are those of `Layout`, but Docker gives the containers theirs, as they come, from the range of the nodes;
    and Kubernetes decides which of the pods' networks is whose.
    """

    @property
    def kind(self) -> str:
        """First word of all names in Docker: of the cluster, its containers, its network, the network's bridge."""
        return f"rofkind{self.number}"

    @property
    def control_plane(self) -> str:
        """The container of the control plane."""
        return f"{self.kind}-control-plane"

    @property
    def first_network(self) -> str:
        """Addresses of this machine, the router, the nodes and the neighbours."""
        return f"{self._address(0, 0)}/24"

    @property
    def given_by_docker(self) -> str:
        """From where Docker takes the addresses of containers."""
        return f"{self._address(0, 8)}/29"

    @property
    def kept_from_docker(self) -> tuple[str, ...]:
        """Addresses in that range that no node has, so that all nodes lie where robots look for them."""
        return tuple(self._address(0, last) for last in (8, 9, 10))

    @property
    def pod_routes(self) -> tuple[str, ...]:
        """None from the start: the router learns them when the nodes are there, and neighbours ask the router."""
        return ()
