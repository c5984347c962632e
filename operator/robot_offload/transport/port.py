"""What the rest of rendering knows of a transport: its ports and its traits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

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
