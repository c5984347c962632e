"""Foreign additions to our objects that server-side apply leaves alone: reported, because they may change what runs.

Only additions with an effect: in pods, in files that pods read, and in ports of Services. What the API server itself
fills in does not count.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Final

from robot_offload.decide.ownership import described
from robot_offload.kube.port import Manifest

_POD_DEFAULTS: Final = frozenset(
    (
        "dnsPolicy",
        "restartPolicy",
        "schedulerName",
        "securityContext",
        "serviceAccount",
        "terminationGracePeriodSeconds",
    )
)
_CONTAINER_DEFAULTS: Final = frozenset(
    ("imagePullPolicy", "resources", "terminationMessagePath", "terminationMessagePolicy")
)
_LISTS: Final = (("containers", "container"), ("initContainers", "init container"), ("volumes", "volume"))
_CONTAINER_LISTS: Final = (("env", "variable", "name"), ("volumeMounts", "mount", "mountPath"))
SHOWN: Final = 10
"""Additions to one object that are named; further ones are counted."""


def additions(wanted: Manifest, live: Manifest) -> str:
    """Return in words what a live object has beyond the wanted one; empty: nothing relevant."""
    found = list(_additions(wanted, live))
    more = f" and {len(found) - SHOWN} more" if len(found) > SHOWN else ""
    return f"{described(live)}: {', '.join(found[:SHOWN])}{more}" if found else ""


def _additions(wanted: Manifest, live: Manifest) -> Iterator[str]:
    match live["kind"]:
        case "ConfigMap":
            yield from _keys("key", wanted.get("data"), live.get("data"))
            yield from _keys("key", wanted.get("binaryData"), live.get("binaryData"))
        case "Service":
            ours, theirs = wanted.get("spec") or {}, live.get("spec") or {}
            yield from _entries("port", "name", ours.get("ports"), theirs.get("ports"))
            yield from (f"address {address}" for address in theirs.get("externalIPs") or ())
        case "Deployment" | "StatefulSet" | "Job":
            yield from _pod(_template(wanted), _template(live))


def _template(workload: Manifest) -> Mapping[str, Any]:
    return ((workload.get("spec") or {}).get("template") or {}).get("spec") or {}


def _pod(wanted: Mapping[str, Any], live: Mapping[str, Any]) -> Iterator[str]:
    lists = {field for field, _ in _LISTS}
    filled = {name for name, value in live.items() if value not in (None, False, [], {})}
    yield from sorted(filled - wanted.keys() - _POD_DEFAULTS - lists)
    for field, word in _LISTS:
        yield from _entries(word, "name", wanted.get(field), live.get(field))
    ours = {one["name"]: one for one in wanted.get("containers") or ()}
    for container in live.get("containers") or ():
        if container.get("name") in ours:
            yield from (f"{found} of container {container['name']}" for found in _container(ours, container))


def _container(ours: Mapping[str, Mapping[str, Any]], live: Mapping[str, Any]) -> Iterator[str]:
    wanted = ours[live["name"]]
    yield from sorted(live.keys() - wanted.keys() - _CONTAINER_DEFAULTS)
    for field, word, key in _CONTAINER_LISTS:
        if field in wanted:
            yield from _entries(word, key, wanted[field], live.get(field))


def _entries(word: str, key: str, wanted: Iterable[Any] | None, live: Iterable[Any] | None) -> Iterator[str]:
    known = {entry.get(key) for entry in wanted or ()}
    yield from (f"{word} {entry.get(key)}" for entry in live or () if entry.get(key) not in known)


def _keys(word: str, wanted: object, live: object) -> Iterator[str]:
    known = wanted if isinstance(wanted, Mapping) else {}
    if isinstance(live, Mapping):
        yield from (f"{word} {name}" for name in sorted(live.keys() - known.keys()))
