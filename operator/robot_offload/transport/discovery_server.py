"""DiscoveryServer: nodes on both sides talk directly and find each other through the cloud's discovery servers.

For networks that carry UDP both ways between the robot and the pods, such as a VPN: only finding each other goes
through the Services, the messages go to the pods' own addresses.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.objects.facts import Endpoint, Facts, Manifest, Purpose
from robot_offload.objects.site import AgentSite
from robot_offload.transport import discovery
from robot_offload.transport.exposure import Exposed, addresses, service
from robot_offload.transport.port import Traits

traits: Final = Traits(robot_speaks_dds=True)
_NO_SESSION: Final = ("pulse_endpoints", "data_endpoints", "pulse_fallback", "data_fallback")


def purposes(offload: RobotOffload) -> tuple[Purpose, ...]:
    """Every server: a participant knows them by their place in the list."""
    return tuple("discovery" for _ in range(offload.spec.cloud.discovery_servers))


def services(offload: RobotOffload, facts: Facts) -> tuple[Manifest, ...]:
    """The servers' Services, of the declared type; nodes in the cluster use the same ones."""
    chosen = offload.spec.transport.expose.node_ports
    first = chosen.discovery if chosen else None
    return tuple(
        service(
            offload,
            facts,
            name,
            "discovery",
            [Exposed(discovery.PORT, discovery.PORT.number, first + server if first else None)],
            discovery.server_selector(server),
            discovery.FOUND_AT_ONCE,
        )
        for server, name in enumerate(discovery.names(offload))
    )


def workloads(offload: RobotOffload, facts: Facts) -> tuple[Manifest, ...]:
    """The servers."""
    return discovery.stateful_sets(offload, facts)


def policies(offload: RobotOffload, facts: Facts) -> tuple[Manifest, ...]:
    """None beside those of every transport."""
    return ()


def node_environment(offload: RobotOffload, facts: Facts) -> dict[str, str]:
    """The servers' addresses in the cluster."""
    return discovery.environment(facts)


def robot_environment(offload: RobotOffload, endpoints: Sequence[Endpoint]) -> dict[str, str]:
    """The servers as the robot reaches them; without shared memory, as in the cloud."""
    servers = [endpoint.address for endpoint in endpoints if endpoint.purpose == "discovery"]
    return {"ROS_DISCOVERY_SERVER": ";".join(servers), "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"}


def robot_files(offload: RobotOffload, endpoints: Sequence[Endpoint], folder: str) -> Mapping[str, bytes]:
    """Nothing more."""
    return {}


def agent_link(offload: RobotOffload, site: AgentSite) -> dict[str, Any]:
    """No session of the agents' own: they talk in topics."""
    return {name: ["none"] for name in _NO_SESSION}


def observed_endpoints(
    offload: RobotOffload, services: Sequence[Manifest], nodes: Sequence[Manifest]
) -> tuple[Endpoint, ...]:
    """One address of each server, in the order of their ids; none before all are known, because places count."""
    found = [addresses(offload, services, nodes, name, discovery.PORT.name) for name in discovery.names(offload)]
    if not all(found):
        return ()
    return tuple(Endpoint("discovery", "UDP", *known[0]) for known in found)
