"""Zenoh: two sessions of the agents' own, opened by the robot, mutually authenticated. The default.

The cloud agent listens behind two Services, UDP and TCP, because many load balancers refuse mixed ones. In the pod
the ports are always the same; what the resource says is what the Services show, so that several robots can share one
address on different ports and no pod is rolled when a port changes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.objects.child_names import TCP, UDP, child_name
from robot_offload.objects.facts import Endpoint, Facts, Manifest, Purpose, address
from robot_offload.objects.site import AgentSite
from robot_offload.transport import discovery
from robot_offload.transport.exposure import Exposed, addresses, service
from robot_offload.transport.port import ContainerPort, Traits

PULSE_PORT: Final = 7447
DATA_PORT: Final = 7448
_PULSE: Final = ContainerPort("pulse", "UDP", PULSE_PORT)
_DATA: Final = ContainerPort("data", "UDP", DATA_PORT)
_PULSE_FALLBACK: Final = ContainerPort("pulse-fallback", "TCP", PULSE_PORT)
_DATA_FALLBACK: Final = ContainerPort("data-fallback", "TCP", DATA_PORT)
_PRIMARY: Final[tuple[Purpose, ...]] = ("pulse", "data")
_FALLBACK: Final[tuple[Purpose, ...]] = ("pulse-fallback", "data-fallback")
_NONE: Final = ["none"]

traits: Final = Traits(agent_ports=(_PULSE, _DATA, _PULSE_FALLBACK, _DATA_FALLBACK), agent_needs_certificates=True)


def purposes(offload: RobotOffload) -> tuple[Purpose, ...]:
    """Pulse and data, and the same again where there is a fallback."""
    return (*_PRIMARY, *(_FALLBACK if offload.spec.transport.zenoh.fallback else ()))


def services(offload: RobotOffload, facts: Facts) -> tuple[Manifest, ...]:
    """The Services of the cloud's agent for the robot, and those of the discovery servers for the nodes."""
    block, chosen = offload.spec.transport.zenoh, offload.spec.transport.expose.node_ports
    udp = [
        Exposed(_PULSE, block.pulse_port, chosen.pulse if chosen else None),
        Exposed(_DATA, block.data_port, chosen.data if chosen else None),
    ]
    tcp = [
        Exposed(_PULSE_FALLBACK, block.pulse_port, chosen.pulse_fallback if chosen else None),
        Exposed(_DATA_FALLBACK, block.data_port, chosen.data_fallback if chosen else None),
    ]
    found = [service(offload, facts, child_name(offload.metadata.name, UDP), "agent", udp)]
    if block.fallback:
        found.append(service(offload, facts, child_name(offload.metadata.name, TCP), "agent", tcp))
    return (*discovery.services(offload, facts), *found)


def workloads(offload: RobotOffload, facts: Facts) -> tuple[Manifest, ...]:
    """The discovery servers."""
    return discovery.stateful_sets(offload, facts)


def policies(offload: RobotOffload, facts: Facts) -> tuple[Manifest, ...]:
    """None: the agent listens itself."""
    return ()


def node_environment(offload: RobotOffload, facts: Facts) -> dict[str, str]:
    """The discovery servers."""
    return discovery.environment(facts)


def robot_environment(offload: RobotOffload, endpoints: Sequence[Endpoint]) -> dict[str, str]:
    """Nothing: the robot's nodes find each other as they always did."""
    return {}


def robot_files(offload: RobotOffload, endpoints: Sequence[Endpoint], folder: str) -> Mapping[str, bytes]:
    """Nothing more."""
    return {}


def agent_link(offload: RobotOffload, site: AgentSite) -> dict[str, Any]:
    """Where the agent listens, or what it dials."""
    fallback = offload.spec.transport.zenoh.fallback
    dialled = {purpose: _dialled(offload, site, purpose) for purpose in (*_PRIMARY, *_FALLBACK)}
    return {
        "pulse_endpoints": [f"quic/{one}" for one in dialled["pulse"]],
        "data_endpoints": [f"quic/{one}" for one in dialled["data"]],
        "pulse_fallback": [f"tls/{one}" for one in dialled["pulse-fallback"]] if fallback else _NONE,
        "data_fallback": [f"tls/{one}" for one in dialled["data-fallback"]] if fallback else _NONE,
    }


def _dialled(offload: RobotOffload, site: AgentSite, purpose: Purpose) -> list[str]:
    block = offload.spec.transport.zenoh
    given = [endpoint.address for endpoint in site.endpoints if endpoint.purpose == purpose]
    pulse = purpose.startswith("pulse")
    port = site.pulse_port or block.pulse_port if pulse else site.data_port or block.data_port
    return given or [address(site.host, port)]


def observed_endpoints(
    offload: RobotOffload, services: Sequence[Manifest], nodes: Sequence[Manifest]
) -> tuple[Endpoint, ...]:
    """The addresses of both Services."""
    udp, tcp = (child_name(offload.metadata.name, word) for word in (UDP, TCP))
    return tuple(
        Endpoint(purpose, "TCP" if purpose in _FALLBACK else "UDP", host, port)
        for purpose in purposes(offload)
        for host, port in addresses(offload, services, nodes, tcp if purpose in _FALLBACK else udp, purpose)
    )
