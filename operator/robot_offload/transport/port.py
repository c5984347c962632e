"""What a transport is: the one place that knows how the two sides meet, on all levels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol

from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.objects.facts import Endpoint, Facts, Manifest, Purpose
from robot_offload.objects.site import AgentSite

IpProtocol = Literal["UDP", "TCP"]


@dataclass(frozen=True, slots=True)
class ContainerPort:
    """A port on which something of ours listens inside its pod; constant, whatever the resource says.

    Attributes:
        name: by which Services find it.
        protocol: UDP or TCP.
        number: in the pod.
    """

    name: str
    protocol: IpProtocol
    number: int


@dataclass(frozen=True, slots=True)
class Traits:
    """What the rest of rendering must know of a transport.

    Attributes:
        agent_ports: what the cloud's agent listens on for the robot.
        agent_needs_certificates: whether the cloud's agent proves who it is.
        by_discovery_servers: whether nodes in the cluster find each other through discovery servers.
        robot_speaks_dds: whether nodes on both sides talk directly, so that the robot's own addresses must pass.
        dds_profile: an XML profile of Fast DDS for every participant in the cloud; empty: none.
    """

    agent_ports: tuple[ContainerPort, ...] = ()
    agent_needs_certificates: bool = False
    by_discovery_servers: bool = True
    robot_speaks_dds: bool = False
    dds_profile: str = ""


class TransportModule(Protocol):
    """A module of this package. Everything is pure."""

    @property
    def traits(self) -> Traits:
        """What kind of transport it is."""
        ...

    def purposes(self, offload: RobotOffload) -> tuple[Purpose, ...]:
        """The addresses that the robot needs; the bundle waits for all of them."""
        ...

    def services(self, offload: RobotOffload, facts: Facts) -> tuple[Manifest, ...]:
        """The Services of this transport."""
        ...

    def workloads(self, offload: RobotOffload, facts: Facts) -> tuple[Manifest, ...]:
        """What runs in the cloud for this transport, and its configuration."""
        ...

    def policies(self, offload: RobotOffload, facts: Facts) -> tuple[Manifest, ...]:
        """The network policies of what `workloads` returns."""
        ...

    def node_environment(self, offload: RobotOffload, facts: Facts) -> dict[str, str]:
        """Environment of nodes and agent in the cloud: how they find each other."""
        ...

    def robot_environment(self, offload: RobotOffload, endpoints: Sequence[Endpoint]) -> dict[str, str]:
        """Environment of nodes and agent on the robot."""
        ...

    def robot_files(self, offload: RobotOffload, endpoints: Sequence[Endpoint], folder: str) -> Mapping[str, bytes]:
        """Files of the bundle beside those of every transport; `folder` is where the bundle lies on the robot."""
        ...

    def agent_link(self, offload: RobotOffload, site: AgentSite) -> dict[str, Any]:
        """The endpoints in the block `link` of an agent's configuration."""
        ...

    def observed_endpoints(
        self, offload: RobotOffload, services: Sequence[Manifest], nodes: Sequence[Manifest]
    ) -> tuple[Endpoint, ...]:
        """Where the robot reaches the cloud, as far as the cluster has said so yet."""
        ...
