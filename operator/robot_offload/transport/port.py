"""The transport's interface for the rest of rendering: its ports and its traits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

IpProtocol = Literal["UDP", "TCP"]


@dataclass(frozen=True, slots=True)
class ContainerPort:
    """A port on which one of our programs listens inside its pod; independent of the resource.

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
    """The facts about a transport for the rest of rendering.

    Attributes:
        agent_ports: the ports on which the cloud's agent listens for the robot.
        agent_needs_certificates: whether the cloud's agent identifies itself.
        by_discovery_servers: whether nodes in the cluster find each other through discovery servers.
        robot_speaks_dds: whether nodes on both sides talk directly, so that the robot's own addresses must pass.
        dds_profile: an XML profile of Fast DDS for every participant in the cloud; empty: none.
    """

    agent_ports: tuple[ContainerPort, ...] = ()
    agent_needs_certificates: bool = False
    by_discovery_servers: bool = True
    robot_speaks_dds: bool = False
    dds_profile: str = ""
