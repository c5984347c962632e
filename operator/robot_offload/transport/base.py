"""The interface of a transport: the one place that knows how the two sides meet, on all levels. Everything is pure.

The defaults are those of most transports: nothing is exposed, the agents talk through topics, and nodes in the cluster
find each other through discovery servers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Final

from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.kube.port import Manifest
from robot_offload.objects.facts import Endpoint, Purpose
from robot_offload.objects.parent import Parent
from robot_offload.objects.site import AgentSite
from robot_offload.transport import discovery
from robot_offload.transport.port import Traits

_SESSIONS: Final = ("pulse_endpoints", "data_endpoints", "pulse_fallback", "data_fallback")


class Transport:
    """One way of connecting the two sides.

    Attributes:
        traits: what the rest of rendering must know about it.
    """

    traits: ClassVar[Traits] = Traits()

    def purposes(self, offload: RobotOffload) -> tuple[Purpose, ...]:
        """Return the addresses that the robot needs; the bundle waits for all of them."""
        return ()

    def services(self, parent: Parent) -> tuple[Manifest, ...]:
        """Return the Services of this transport."""
        return discovery.services(parent) if self.traits.by_discovery_servers else ()

    def workloads(self, parent: Parent) -> tuple[Manifest, ...]:
        """Return the cloud's workloads for this transport, and their configuration."""
        return discovery.stateful_sets(parent) if self.traits.by_discovery_servers else ()

    def policies(self, parent: Parent) -> tuple[Manifest, ...]:
        """Return the network policies for the objects of `workloads`, beside those of every transport."""
        return ()

    def node_environment(self, parent: Parent) -> dict[str, str]:
        """Return the environment of nodes and agent in the cloud: how they find each other."""
        return discovery.environment(parent.facts) if self.traits.by_discovery_servers else {}

    def robot_environment(self, offload: RobotOffload, endpoints: Sequence[Endpoint]) -> dict[str, str]:
        """Return the environment of nodes and agent on the robot; empty: discovery is unchanged."""
        return {}

    def robot_files(
        self, offload: RobotOffload, endpoints: Sequence[Endpoint], folder: str, state_dir: str
    ) -> Mapping[str, bytes]:
        """Return the bundle's files beside those of every transport; it will be in `folder` on the robot."""
        return {}

    def agent_link(self, offload: RobotOffload, site: AgentSite) -> dict[str, Any]:
        """Return the endpoints in the block `link` of an agent's configuration."""
        return {session: ["none"] for session in _SESSIONS}

    def observed_endpoints(
        self, offload: RobotOffload, services: Sequence[Manifest], nodes: Sequence[Manifest]
    ) -> tuple[Endpoint, ...]:
        """Return the addresses at which the robot reaches the cloud, as far as the cluster has assigned them."""
        return ()
