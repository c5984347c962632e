"""The ways of connecting robot and cloud, one module each. Pure: no I/O, no clock, no environment.

`of(spec)` is the transport of a specification; `base` defines what it must offer.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Final

from robot_offload.api.v1alpha1 import RobotOffload, RobotOffloadSpec, TransportType
from robot_offload.kube.port import Manifest
from robot_offload.objects.facts import Endpoint, Purpose
from robot_offload.transport.base import Transport
from robot_offload.transport.dds_router import DDSRouter
from robot_offload.transport.discovery_server import DiscoveryServer
from robot_offload.transport.port import ContainerPort
from robot_offload.transport.static_peers import StaticPeers
from robot_offload.transport.zenoh import DATA_PORT, PULSE_PORT, Zenoh

__all__ = [
    "DATA_PORT",
    "PULSE_PORT",
    "Transport",
    "agent_ports",
    "discovery_servers",
    "missing_purposes",
    "needs_certificates",
    "observed_endpoints",
    "of",
]

_TRANSPORTS: Final[dict[TransportType, Transport]] = {
    "Zenoh": Zenoh(),
    "DDSRouter": DDSRouter(),
    "DiscoveryServer": DiscoveryServer(),
    "StaticPeers": StaticPeers(),
}


def of(spec: RobotOffloadSpec) -> Transport:
    """Return the transport of a specification."""
    return _TRANSPORTS[spec.transport.type]


def agent_ports(offload: RobotOffload) -> tuple[ContainerPort, ...]:
    """Return the ports on which the cloud's agent listens for the robot: one for each address that the robot needs."""
    chosen = of(offload.spec)
    wanted = chosen.purposes(offload)
    return tuple(port for port in chosen.traits.agent_ports if port.name in wanted)


def discovery_servers(spec: RobotOffloadSpec) -> int:
    """Return how many discovery servers run in the cloud."""
    return spec.cloud.discovery_servers if of(spec).traits.by_discovery_servers else 0


def needs_certificates(spec: RobotOffloadSpec) -> bool:
    """Return whether something in the cloud identifies itself with a certificate."""
    return spec.transport.type in ("Zenoh", "DDSRouter")


def observed_endpoints(
    offload: RobotOffload, services: Sequence[Manifest], nodes: Sequence[Manifest]
) -> tuple[Endpoint, ...]:
    """Return the addresses at which the robot reaches the cloud, as far as the cluster has assigned them.

    Args:
        offload: owner of the endpoints.
        services: the Services of its namespace as they are now, with their status; others are ignored.
        nodes: the cluster's nodes; only used for Services of type NodePort.
    """
    return of(offload.spec).observed_endpoints(offload, services, nodes)


def missing_purposes(offload: RobotOffload, endpoints: Sequence[Endpoint]) -> tuple[Purpose, ...]:
    """Return the purposes for which the robot needs an address that is not yet known."""
    wanted = Counter(of(offload.spec).purposes(offload))
    known = Counter(endpoint.purpose for endpoint in endpoints)
    return tuple(purpose for purpose, count in wanted.items() if known[purpose] < count)
