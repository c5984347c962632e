"""Configurations of eProsima's DDS Router, version v5.0, and our own check of them.

The router ignores unknown keys, so a misspelt one would be lost silently; its own validator knows only an old version.
The tables below list what it reads (from the sources of DDS Router 3.4.0 and DDS-Pipe 1.4.0).

Every topic has one direction. Without routes the router creates a writer and a reader for each allowed topic on both
sides: messages published in the cloud under a public name would reach the robot's nodes past the lease.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Final

from robot_offload.errors import RobotOffloadError

VERSION: Final = "v5.0"
CLUSTER: Final = "Cluster"
ROBOT: Final = "Robot"
WAN: Final = "Wan"
THREADS: Final = 4

_TOP: Final = {"version", "participants", "specs", "allowlist", "routes", "topic-routes", "xml"}
_SPECS: Final = {"threads", "discovery-trigger", "logging"}
_COMMON: Final = {"name", "kind"}
_PARTICIPANTS: Final[dict[str, set[str]]] = {
    "local": {*_COMMON, "domain", "transport"},
    "local-discovery-server": {*_COMMON, "domain", "connection-addresses"},
    "xml": {*_COMMON, "profile"},
}
_ADDRESS: Final = {"ip", "port", "transport", "ip-version"}
_MAX_DOMAIN: Final = 232


class RouterConfigError(RobotOffloadError):
    """A configuration that the router would refuse or, worse, misread."""


def address(host: str, port: int, transport: str) -> dict[str, Any]:
    """Return an address in the router's form.

    Args:
        host: an IP address.
        port: of the listener.
        transport: `udp` or `tcp`.
    """
    result: dict[str, Any] = {"ip": host, "port": port, "transport": transport}
    return {**result, "ip-version": "v6"} if ":" in host else result


def config(
    local: Mapping[str, Any], profile: str, xml: str, to_cloud: Sequence[str], to_robot: Mapping[str, str]
) -> dict[str, Any]:
    """Return a whole configuration: one participant for the nodes of this side, one for the other side.

    Args:
        local: the participant for the nodes of this side; its name identifies this side.
        profile: the name of the other participant's profile.
        xml: profiles of Fast DDS.
        to_cloud: topics that cross towards the cloud, of any type.
        to_robot: topics that cross towards the robot, with their types: a separate route needs a topic's type.

    Raises:
        RouterConfigError: the router would misread it.
    """
    here = str(local["name"])
    source, target = (here, WAN) if here == ROBOT else (WAN, here)
    result = {
        "version": VERSION,
        # By its writers: our reader waits for a publisher, and a late reader still gets the kept messages.
        "specs": {"threads": THREADS, "discovery-trigger": "writer", "logging": {"verbosity": "warning"}},
        "allowlist": [{"name": dds_name(topic)} for topic in (*to_cloud, *to_robot)],
        "routes": _one_way(source, target),
        "topic-routes": [
            {"name": dds_name(topic), "type": dds_type(kind), "routes": _one_way(target, source)}
            for topic, kind in to_robot.items()
        ],
        "xml": {"raw": xml},
        "participants": [dict(local), {"name": WAN, "kind": "xml", "profile": profile}],
    }
    found = problems(result)
    if found:
        raise RouterConfigError("\n".join(found))
    return result


def dds_name(topic: str) -> str:
    """Return a topic's name in DDS: `/scan` -> `rt/scan`."""
    return f"rt{topic}"


def dds_type(interface: str) -> str:
    """Return a type's name in DDS: `std_msgs/msg/Header` -> `std_msgs::msg::dds_::Header_`."""
    package, kind, name = interface.split("/")
    return f"{package}::{kind}::dds_::{name}_"


def _one_way(source: str, target: str) -> list[dict[str, Any]]:
    """Return routes from one participant to the other; a source without targets forwards nowhere."""
    return [{"src": source, "dst": [target]}, {"src": target}]


def problems(document: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the problems of a configuration, one line each."""
    return tuple(_problems(document))


def _problems(document: Mapping[str, Any]) -> Iterator[str]:
    yield from _unknown("", document, _TOP)
    yield from _unknown("specs", document.get("specs") or {}, _SPECS)
    if document.get("version") != VERSION:
        yield f"version: must be {VERSION}; the router refuses or misreads others"
    yield from _allowlist(document.get("allowlist"))
    participants = document.get("participants") or ()
    if len(participants) < 2:
        yield "participants: at least two are needed, there is nothing to route otherwise"
    names = [str(one.get("name")) for one in participants]
    if len(set(names)) != len(names):
        yield "participants: each name once"
    for index, one in enumerate(participants):
        yield from _participant(f"participants[{index}]", one)
    yield from _routes("routes", document.get("routes") or (), names)
    allowed = {entry.get("name") for entry in document.get("allowlist") or ()}
    for index, entry in enumerate(document.get("topic-routes") or ()):
        yield from _topic_route(f"topic-routes[{index}]", entry, names, allowed)
    yield from _unknown("xml", document.get("xml") or {}, {"raw"})


def _unknown(path: str, values: Mapping[str, Any], known: Iterable[str]) -> Iterator[str]:
    for key in values:
        if key not in known:
            yield f"{path + '.' if path else ''}{key}: the router does not know this key and would ignore it"


def _allowlist(entries: Any) -> Iterator[str]:
    if not entries:
        yield "allowlist: must not be empty, an empty one lets every topic through"
    for index, entry in enumerate(entries or ()):
        path = f"allowlist[{index}]"
        yield from _unknown(path, entry, {"name"})
        name = str(entry.get("name", ""))
        if not name.startswith("rt/"):
            yield f"{path}.name: {name!r} is not a topic of ROS 2 (rt/)"
        if "*" in name:
            yield f"{path}.name: {name!r} holds a wildcard; only declared topics cross"


def _routes(path: str, entries: Sequence[Mapping[str, Any]], names: Sequence[str]) -> Iterator[str]:
    sources = [str(entry.get("src")) for entry in entries]
    for name in names:
        if sources.count(name) != 1:
            yield f"{path}: {name} needs exactly one route; a participant without one forwards everywhere"
    for index, entry in enumerate(entries):
        yield from _unknown(f"{path}[{index}]", entry, {"src", "dst"})
        for name in (entry.get("src"), *(entry.get("dst") or ())):
            if name not in names:
                yield f"{path}[{index}]: {name!r} is not a participant"
    both_ways = {(entry.get("src"), target) for entry in entries for target in entry.get("dst") or ()}
    if any((target, source) in both_ways for source, target in both_ways):
        yield f"{path}: a topic would cross both ways; whoever publishes it on one side is heard on the other"


def _topic_route(path: str, entry: Mapping[str, Any], names: Sequence[str], allowed: set[Any]) -> Iterator[str]:
    yield from _unknown(path, entry, {"name", "type", "routes"})
    if entry.get("name") not in allowed:
        yield f"{path}.name: {entry.get('name')!r} is not in the allowlist"
    if not entry.get("type"):
        yield f"{path}.type: is needed"
    yield from _routes(f"{path}.routes", entry.get("routes") or (), names)


def _participant(path: str, one: Mapping[str, Any]) -> Iterator[str]:
    kind = str(one.get("kind"))
    if kind not in _PARTICIPANTS:
        yield f"{path}.kind: {kind!r} is none of {', '.join(sorted(_PARTICIPANTS))}"
        return
    yield from _unknown(path, one, _PARTICIPANTS[kind])
    if kind == "xml" and not one.get("profile"):
        yield f"{path}.profile: is needed"
    domain = one.get("domain", 0)
    if not isinstance(domain, int) or not 0 <= domain <= _MAX_DOMAIN:
        yield f"{path}.domain: {domain!r} is not within 0 .. {_MAX_DOMAIN}"
    addresses = one.get("connection-addresses") or ()
    if kind == "local-discovery-server" and not addresses:
        yield f"{path}: needs an address to connect to"
    for number, entry in enumerate(addresses):
        yield from _address(f"{path}.addresses[{number}]", entry)


def _address(path: str, entry: Mapping[str, Any]) -> Iterator[str]:
    yield from _unknown(path, entry, _ADDRESS)
    if not entry.get("ip"):
        yield f"{path}.ip: is needed"
    if entry.get("transport") not in ("tcp", "udp"):
        yield f"{path}.transport: must be tcp or udp"
    if not 0 < int(entry.get("port", 0)) < 65536:
        yield f"{path}.port: {entry.get('port')!r} is not a port"
    if entry.get("ip") in ("0.0.0.0", "::"):  # noqa: S104 - refused here
        yield f"{path}.ip: is what the router connects to; no connection is possible to {entry['ip']}"
