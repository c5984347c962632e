"""StaticPeers: nodes on both sides talk directly, and each side gets the other's addresses.

For a flat network without multicast between the two sides, and for tests. It runs nothing in the cloud, not even a
discovery server: Fast DDS does not combine those with listed peers. Inside the cluster the pods find each other by
multicast, if its network carries it, or because they are listed.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Final

from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.objects.facts import Endpoint
from robot_offload.objects.parent import Parent
from robot_offload.transport.base import Transport
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
"""A listed address has no port, so Fast DDS asks the first four participants there. A robot has more: the agent alone
is four. UDP alone, as in all pods."""


def _environment(peers: Sequence[str]) -> dict[str, str]:
    # The default range is written out: with OFF the listed peers would be ignored, too.
    listed = {"ROS_STATIC_PEERS": ";".join(peers)} if peers else {}
    return {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET", **listed}


class StaticPeers(Transport):
    """Gives each side the addresses of the other."""

    traits: ClassVar[Traits] = Traits(by_discovery_servers=False, robot_speaks_dds=True, dds_profile=_PROFILE)

    def node_environment(self, parent: Parent) -> dict[str, str]:
        """Return the robot's addresses, and the cloud's own."""
        block = parent.spec.transport.static_peers
        return _environment((*block.robot, *block.cloud))

    def robot_environment(self, offload: RobotOffload, endpoints: Sequence[Endpoint]) -> dict[str, str]:
        """Return the cloud's addresses; without shared memory, as in the cloud."""
        peers = offload.spec.transport.static_peers.cloud
        return {**_environment(peers), "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"}
