"""DiscoveryServer: nodes on both sides talk directly and find each other through the cloud's discovery servers.

For networks with UDP both ways between the robot and the pods, such as a VPN: only discovery goes through the Services,
messages go to the pods' own addresses.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.kube.port import Manifest
from robot_offload.objects.facts import Endpoint, Purpose
from robot_offload.objects.parent import Parent
from robot_offload.transport import discovery
from robot_offload.transport.base import Transport
from robot_offload.transport.exposure import Exposed, addresses, service
from robot_offload.transport.port import Traits


class DiscoveryServer(Transport):
    """Lets nodes of both sides find each other through the cloud's discovery servers."""

    traits: ClassVar[Traits] = Traits(robot_speaks_dds=True)

    def purposes(self, offload: RobotOffload) -> tuple[Purpose, ...]:
        """Return all servers: a participant knows them by their place in the list."""
        return tuple("discovery" for _ in range(offload.spec.cloud.discovery_servers))

    def services(self, parent: Parent) -> tuple[Manifest, ...]:
        """Return the servers' Services, of the declared type; nodes in the cluster also use them."""
        chosen = parent.spec.transport.expose.node_ports
        first = chosen.discovery if chosen else None
        return tuple(
            service(
                parent,
                discovery.part(server, name),
                [Exposed(discovery.PORT, discovery.PORT.number, first + server if first else None)],
                discovery.FOUND_AT_ONCE,
            )
            for server, name in enumerate(discovery.names(parent.offload))
        )

    def robot_environment(self, offload: RobotOffload, endpoints: Sequence[Endpoint]) -> dict[str, str]:
        """Return the servers' addresses for the robot; without shared memory, as in the cloud."""
        servers = [endpoint.address for endpoint in endpoints if endpoint.purpose == "discovery"]
        return {"ROS_DISCOVERY_SERVER": ";".join(servers), "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"}

    def observed_endpoints(
        self, offload: RobotOffload, services: Sequence[Manifest], nodes: Sequence[Manifest]
    ) -> tuple[Endpoint, ...]:
        """Return one address of each server, by id; none before all are known, because their order counts."""
        found = [addresses(offload, services, nodes, name, discovery.PORT.name) for name in discovery.names(offload)]
        if not all(found):
            return ()
        return tuple(Endpoint("discovery", "UDP", *known[0]) for known in found)
