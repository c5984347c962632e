"""StaticPeers: nodes on both sides talk directly, and each side is told the other's addresses.

For a flat network without multicast between the two sides, and for tests. Nothing runs in the cloud for it, no
discovery server either: those and listed peers exclude each other in Fast DDS. Inside the cluster the pods find each
other by multicast, where its network carries it, or because they are listed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.objects.facts import Endpoint, Facts, Manifest, Purpose
from robot_offload.objects.site import AgentSite
from robot_offload.transport.discovery_server import agent_link as _topics_only
from robot_offload.transport.port import Traits

_PROFILE: Final = """\
<?xml version="1.0" encoding="UTF-8"?>
<dds xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
  <profiles>
    <transport_descriptors>
      <transport_descriptor>
        <transport_id>udp</transport_id>
        <type>UDPv4</type>
        <maxInitialPeersRange>32</maxInitialPeersRange>
      </transport_descriptor>
    </transport_descriptors>
    <participant profile_name="robot_offload" is_default_profile="true">
      <rtps>
        <userTransports><transport_id>udp</transport_id></userTransports>
        <useBuiltinTransports>false</useBuiltinTransports>
      </rtps>
    </participant>
  </profiles>
</dds>
"""
"""A listed address has no port, and Fast DDS asks the first four participants there. A robot has more of them: the
agent alone is four. UDP alone, as in all pods."""

traits: Final = Traits(by_discovery_servers=False, robot_speaks_dds=True, dds_profile=_PROFILE)


def purposes(offload: RobotOffload) -> tuple[Purpose, ...]:
    """None: the addresses are in the resource."""
    return ()


def services(offload: RobotOffload, facts: Facts) -> tuple[Manifest, ...]:
    """None: nothing listens."""
    return ()


def workloads(offload: RobotOffload, facts: Facts) -> tuple[Manifest, ...]:
    """None."""
    return ()


def policies(offload: RobotOffload, facts: Facts) -> tuple[Manifest, ...]:
    """None beside those of every transport."""
    return ()


def node_environment(offload: RobotOffload, facts: Facts) -> dict[str, str]:
    """The robot's addresses, and those of the cloud itself."""
    block = offload.spec.transport.static_peers
    return _environment((*block.robot, *block.cloud))


def robot_environment(offload: RobotOffload, endpoints: Sequence[Endpoint]) -> dict[str, str]:
    """The cloud's addresses; without shared memory, as in the cloud."""
    peers = offload.spec.transport.static_peers.cloud
    return {**_environment(peers), "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"}


def robot_files(offload: RobotOffload, endpoints: Sequence[Endpoint], folder: str) -> Mapping[str, bytes]:
    """Nothing more."""
    return {}


def agent_link(offload: RobotOffload, site: AgentSite) -> dict[str, Any]:
    """No session of the agents' own: they talk in topics."""
    return _topics_only(offload, site)


def observed_endpoints(
    offload: RobotOffload, services: Sequence[Manifest], nodes: Sequence[Manifest]
) -> tuple[Endpoint, ...]:
    """None: nothing of the cluster is exposed."""
    return ()


def _environment(peers: Sequence[str]) -> dict[str, str]:
    # The range is said although it is the default: with OFF the listed peers would be left alone too.
    listed = {"ROS_STATIC_PEERS": ";".join(peers)} if peers else {}
    return {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET", **listed}
