"""Configurations of eProsima's DDS Router, version v5.0, and our own check of them.

The router ignores keys that it does not know, so a misspelt one would be lost in silence; its own validator knows an
old version only. What it would accept stands in the tables below (read in the sources of DDS Router 3.5.0 and
DDS-Pipe 1.5.0, and run with 3.4.0).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from robot_offload.errors import RobotOffloadError

VERSION: Final = "v5.0"
CLUSTER: Final = "Cluster"
ROBOT: Final = "Robot"
WAN: Final = "Wan"

_TOP: Final = {"version", "participants", "specs", "allowlist"}
_SPECS: Final = {"threads", "logging"}
_COMMON: Final = {"name", "kind"}
_PARTICIPANTS: Final[dict[str, set[str]]] = {
    "local": {*_COMMON, "domain"},
    "local-discovery-server": {*_COMMON, "domain", "connection-addresses"},
    "wan": {*_COMMON, "listening-addresses", "connection-addresses", "tls"},
}
_ADDRESS: Final = {"ip", "domain", "port", "external-port", "transport", "ip-version"}
_TLS_SERVER: Final = {"private_key", "cert", "dh_params"}
_TLS_CLIENT: Final = {"ca", "sni_host"}
_MAX_DOMAIN: Final = 232


class RouterConfigError(RobotOffloadError):
    """A configuration that the router would refuse or, worse, read otherwise than it is meant."""


def allowed(topics: Sequence[str]) -> list[dict[str, str]]:
    """Topics as DDS knows them: `/scan` -> `rt/scan`."""
    return [{"name": f"rt{topic}"} for topic in topics]


def address(host: str, port: int, transport: str, external_port: int | None = None) -> dict[str, Any]:
    """An address: an IP address or a DNS name, which the router resolves once, when it starts."""
    is_v6 = ":" in host
    is_ip = is_v6 or all(part.isdigit() for part in host.split("."))
    result: dict[str, Any] = {"ip" if is_ip else "domain": host, "port": port, "transport": transport}
    if external_port is not None:
        result["external-port"] = external_port
    return {**result, "ip-version": "v6"} if is_v6 else result


def config(participants: Sequence[Mapping[str, Any]], topics: Sequence[str]) -> dict[str, Any]:
    """A whole configuration; both sides allow the same topics, because a topic must pass both routers.

    Raises:
        RouterConfigError: it is not one that the router reads as it is meant.
    """
    result = {
        "version": VERSION,
        "specs": {"threads": 4, "logging": {"verbosity": "warning"}},
        "allowlist": allowed(topics),
        "participants": [dict(one) for one in participants],
    }
    found = problems(result)
    if found:
        raise RouterConfigError("\n".join(found))
    return result


def problems(document: Mapping[str, Any]) -> tuple[str, ...]:
    """What is wrong with a configuration, one line each."""
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
    names = [one.get("name") for one in participants]
    if len(set(names)) != len(names):
        yield "participants: each name once"
    for index, one in enumerate(participants):
        yield from _participant(f"participants[{index}]", one)


def _unknown(path: str, values: Mapping[str, Any], known: set[str]) -> Iterator[str]:
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
        if not name.startswith(("rt/", "rq/", "rr/")):
            yield f"{path}.name: {name!r} is not a topic, request or reply of ROS 2 (rt/, rq/, rr/)"
        if "*" in name:
            yield f"{path}.name: {name!r} holds a wildcard; only declared topics cross"


def _participant(path: str, one: Mapping[str, Any]) -> Iterator[str]:
    kind = str(one.get("kind"))
    if kind not in _PARTICIPANTS:
        yield f"{path}.kind: {kind!r} is none of {', '.join(sorted(_PARTICIPANTS))}"
        return
    yield from _unknown(path, one, _PARTICIPANTS[kind])
    domain = one.get("domain", 0)
    if not isinstance(domain, int) or not 0 <= domain <= _MAX_DOMAIN:
        yield f"{path}.domain: {domain!r} is not within 0 .. {_MAX_DOMAIN}"
    listening, connecting = one.get("listening-addresses") or (), one.get("connection-addresses") or ()
    if kind != "local" and not listening and not connecting:
        yield f"{path}: needs an address to listen on or to connect to"
    if len(listening) > 1:
        yield f"{path}.listening-addresses: only the first TCP port would be opened"
    for number, entry in enumerate((*listening, *connecting)):
        yield from _address(f"{path}.addresses[{number}]", entry)
    if "tls" in one:
        yield from _tls(f"{path}.tls", one["tls"], server=bool(listening))


def _address(path: str, entry: Mapping[str, Any]) -> Iterator[str]:
    yield from _unknown(path, entry, _ADDRESS)
    if ("ip" in entry) == ("domain" in entry):
        yield f"{path}: needs either ip or domain"
    if entry.get("transport") not in ("tcp", "udp"):
        yield f"{path}.transport: must be tcp or udp"
    for key in ("port", "external-port"):
        if key in entry and not 0 < int(entry[key]) < 65536:
            yield f"{path}.{key}: {entry[key]!r} is not a port"
    if entry.get("transport") == "udp" and entry.get("external-port", entry.get("port")) != entry.get("port"):
        yield f"{path}.external-port: must be the port itself with udp"
    if entry.get("ip") in ("0.0.0.0", "::"):  # noqa: S104 - refused here
        yield f"{path}.ip: is what the router announces; nobody can connect to {entry['ip']}"


def _tls(path: str, values: Mapping[str, Any], *, server: bool) -> Iterator[str]:
    yield from _unknown(path, values, _TLS_SERVER if server else _TLS_CLIENT)
    for key in sorted(_TLS_SERVER if server else {"ca"}):
        if not values.get(key):
            yield f"{path}.{key}: is needed"
