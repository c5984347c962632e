"""Zenoh: two sessions of the agents' own, opened by the robot, mutually authenticated. The default.

The cloud agent listens behind two Services, UDP and TCP, because many load balancers refuse a mix. The ports in the pod
are fixed; the resource's ports are those of the Services, so that several robots can share one address on different
ports and no pod is rolled when a port changes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, Final

from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.kube.port import Manifest
from robot_offload.objects.facts import Endpoint, Purpose, address
from robot_offload.objects.names import TCP, UDP, child_name
from robot_offload.objects.parent import Parent, Part
from robot_offload.objects.site import AgentSite
from robot_offload.transport.base import Transport
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


def _dialled(offload: RobotOffload, site: AgentSite, purpose: Purpose) -> list[str]:
    block = offload.spec.transport.zenoh
    given = [endpoint.address for endpoint in site.endpoints if endpoint.purpose == purpose]
    pulse = purpose.startswith("pulse")
    port = site.pulse_port or block.pulse_port if pulse else site.data_port or block.data_port
    return given or [address(site.host, port)]


class Zenoh(Transport):
    """Connects the sides with two sessions of the agents' own."""

    traits: ClassVar[Traits] = Traits(
        agent_ports=(_PULSE, _DATA, _PULSE_FALLBACK, _DATA_FALLBACK), agent_needs_certificates=True
    )

    def purposes(self, offload: RobotOffload) -> tuple[Purpose, ...]:
        """Return pulse and data, and the same again if there is a fallback."""
        return (*_PRIMARY, *(_FALLBACK if offload.spec.transport.zenoh.fallback else ()))

    def services(self, parent: Parent) -> tuple[Manifest, ...]:
        """Return the Services of the cloud's agent for the robot, and those of the discovery servers for the nodes."""
        block, chosen = parent.spec.transport.zenoh, parent.spec.transport.expose.node_ports
        udp = [
            Exposed(_PULSE, block.pulse_port, chosen.pulse if chosen else None),
            Exposed(_DATA, block.data_port, chosen.data if chosen else None),
        ]
        tcp = [
            Exposed(_PULSE_FALLBACK, block.pulse_port, chosen.pulse_fallback if chosen else None),
            Exposed(_DATA_FALLBACK, block.data_port, chosen.data_fallback if chosen else None),
        ]
        found = [service(parent, Part(child_name(parent.name, UDP), "agent"), udp)]
        if block.fallback:
            found.append(service(parent, Part(child_name(parent.name, TCP), "agent"), tcp))
        return (*super().services(parent), *found)

    def agent_link(self, offload: RobotOffload, site: AgentSite) -> dict[str, Any]:
        """Return the agent's listening or dialled endpoints."""
        fallback = offload.spec.transport.zenoh.fallback
        dialled = {purpose: _dialled(offload, site, purpose) for purpose in (*_PRIMARY, *_FALLBACK)}
        return {
            "pulse_endpoints": [f"quic/{one}" for one in dialled["pulse"]],
            "data_endpoints": [f"quic/{one}" for one in dialled["data"]],
            "pulse_fallback": [f"tls/{one}" for one in dialled["pulse-fallback"]] if fallback else _NONE,
            "data_fallback": [f"tls/{one}" for one in dialled["data-fallback"]] if fallback else _NONE,
        }

    def observed_endpoints(
        self, offload: RobotOffload, services: Sequence[Manifest], nodes: Sequence[Manifest]
    ) -> tuple[Endpoint, ...]:
        """Return the addresses of both Services."""
        udp, tcp = (child_name(offload.metadata.name, word) for word in (UDP, TCP))
        return tuple(
            Endpoint(purpose, "TCP" if purpose in _FALLBACK else "UDP", host, port)
            for purpose in self.purposes(offload)
            for host, port in addresses(offload, services, nodes, tcp if purpose in _FALLBACK else udp, purpose)
        )
