"""The router's participant for the other side, as a profile of Fast DDS, for settings that its YAML lacks.

Plain TCP over the loopback interface to the end of the tunnel on the same host (see `tunnel`), without Nagle's
algorithm: it would make small messages wait for the acknowledgement of earlier ones, which doubles the latency.
"""

from __future__ import annotations

from typing import Final
from xml.etree import ElementTree

PROFILE: Final = "wan"
HOST: Final = "127.0.0.1"
"""Where routers and tunnels meet, and the only address that they announce. Fast DDS finds the connection to a
participant by its announced address, which must be the one from which it dials: on an outside interface both change
with the network, and a router that started without one would be unreachable for ever."""
MEETING: Final = 11667
"""The port that the robot's router dials and the cloud's router announces: the robot's router keeps to the connection
that leads to the announced address. On the robot the tunnel listens there."""
LISTENING: Final = 11668
"""The port on which the cloud's router waits for the tunnel; it is unreachable from outside the pod."""
NAMESPACE: Final = "http://www.eprosima.com"
_ANNOUNCED_EVERY_S: Final = 1
_LOST_AFTER_S: Final = 10
_RECOVERED_EVERY_MS: Final = 100
"""How often a reliable writer announces unacknowledged messages. Only then are those lost in a cut requested again, and
later messages wait for them; with Fast DDS's own 3 s, inputs stayed stale for as long after a cut."""


def profile(*, listening: int = 0, meeting: int = MEETING) -> str:
    """Return the XML document.

    Args:
        listening: the port on which this router waits for the other one; 0: it dials, as the robot's does.
        meeting: the dialled and announced port; another one only if both sides run on one machine.
    """
    root = ElementTree.Element("dds", xmlns=NAMESPACE)
    profiles = _add(root, "profiles")
    descriptor = _add(_add(profiles, "transport_descriptors"), "transport_descriptor")
    _add(descriptor, "transport_id", "tunnel")
    _add(descriptor, "type", "TCPv4")
    _add(_add(descriptor, "interfaceWhiteList"), "address", HOST)
    if listening:
        _add(_add(descriptor, "listening_ports"), "port", str(listening))
    _add(descriptor, "enable_tcp_nodelay", "true")
    writer = _add(profiles, "data_writer")
    writer.set("profile_name", "prompt")
    writer.set("is_default_profile", "true")
    _add(_add(_add(writer, "times"), "heartbeat_period"), "nanosec", str(_RECOVERED_EVERY_MS * 1_000_000))
    participant = _add(profiles, "participant")
    participant.set("profile_name", PROFILE)
    _add(participant, "domainId", "0")
    rtps = _add(participant, "rtps")
    _add(_add(rtps, "userTransports"), "transport_id", "tunnel")
    _add(rtps, "useBuiltinTransports", "false")
    if listening:
        _locator(_add(rtps, "defaultUnicastLocatorList"), meeting)
    builtin = _add(rtps, "builtin")
    discovery = _add(builtin, "discovery_config")
    _add(_add(discovery, "leaseDuration"), "sec", str(_LOST_AFTER_S))
    _add(_add(discovery, "leaseAnnouncement"), "sec", str(_ANNOUNCED_EVERY_S))
    _locator(_add(builtin, "metatrafficUnicastLocatorList" if listening else "initialPeersList"), meeting)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def _add(parent: ElementTree.Element, tag: str, text: str | None = None) -> ElementTree.Element:
    child = ElementTree.SubElement(parent, tag)
    child.text = text
    return child


def _locator(parent: ElementTree.Element, port: int) -> None:
    tcp = _add(_add(parent, "locator"), "tcpv4")
    _add(tcp, "address", HOST)
    _add(tcp, "physical_port", str(port))
    _add(tcp, "port", "0")
