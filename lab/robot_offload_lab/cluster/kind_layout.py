"""Names and addresses of a cluster whose nodes are Docker containers: those of a layout, and Docker's."""

from __future__ import annotations

from dataclasses import dataclass

from robot_offload_lab.cluster.layout import Layout

MOST_NODES = 4
"""Nodes beside the control plane: Docker may assign this many node addresses."""


@dataclass(frozen=True, slots=True)
class KindLayout(Layout):
    """Where everything is when kind makes the nodes.

    Addresses are those of `Layout`, but Docker assigns those of the containers in order of arrival, from the range of
    the nodes, and Kubernetes assigns the pods' networks to nodes.
    """

    @property
    def kind(self) -> str:
        """First word of all names in Docker: those of the cluster, its containers, its network and the bridge."""
        return f"rofkind{self.number}"

    @property
    def control_plane(self) -> str:
        """The container of the control plane."""
        return f"{self.kind}-control-plane"

    @property
    def first_network(self) -> str:
        """Address range of this machine, the router, the nodes and the neighbours."""
        return f"{self._address(0, 0)}/24"

    @property
    def given_by_docker(self) -> str:
        """Range from which Docker takes the addresses of containers."""
        return f"{self._address(0, 8)}/29"

    @property
    def kept_from_docker(self) -> tuple[str, ...]:
        """Addresses in that range that no node gets, so that all nodes are where robots look for them."""
        return tuple(self._address(0, last) for last in (8, 9, 10))

    @property
    def pod_routes(self) -> tuple[str, ...]:
        """None at the start: the router learns them when the nodes exist, and neighbours ask the router."""
        return ()
