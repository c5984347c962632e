"""Warns of RobotOffloads that disturb each other: where a network joins both sides, they share a ROS domain.

Only those of one namespace are compared: a user may not be allowed to read the names of others.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Final

from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.findings import Finding
from robot_offload.kube.port import Manifest

_JOINED: Final = ("DiscoveryServer", "StaticPeers")
"""Transports that put robots and clouds into one DDS network."""
COMPARED: Final = 200
"""Most RobotOffloads of a namespace that are compared: each one is read at each pass."""
SHOWN: Final = 3


def matter(offload: RobotOffload) -> bool:
    """Return whether a RobotOffload can disturb others at all."""
    return offload.spec.transport.type in _JOINED


def findings(offload: RobotOffload, others: Iterable[Manifest]) -> Iterator[Finding]:
    """Yield a warning for each kind of thing that a RobotOffload shares with others and should not.

    Args:
        offload: a valid one for which `matter` is true.
        others: those of its namespace as the API server has them, with or without itself.
    """
    spec = offload.spec
    neighbours = [one for one in others if one["metadata"]["name"] != offload.metadata.name and _joined(one)]
    peers = set(spec.transport.static_peers.robot)
    same = [one for one in neighbours if peers & set(_peers(one))]
    if same:
        yield Finding(
            "spec.transport.staticPeers.robot",
            "SameRobot",
            f"{_names(same)} names an address of this robot as well, so two clouds would act for one robot; delete one",
            "warning",
        )
    room = (spec.robot.domain_id, spec.robot.namespace)
    same = [one for one in neighbours if one not in same and _room(one) == room]
    if same:
        yield Finding(
            "spec.robot.domainID",
            "SameDomain",
            f"{_names(same)} has domain {room[0]} and namespace {room[1]} as well, and this transport joins their "
            "networks; give each robot a domain or a namespace of its own if they can reach each other",
            "warning",
        )


def _names(manifests: Iterable[Manifest]) -> str:
    names = sorted(str(one["metadata"]["name"]) for one in manifests)
    return ", ".join(names[:SHOWN]) + (f" and {len(names) - SHOWN} more" if len(names) > SHOWN else "")


def _part(manifest: Manifest, *path: str) -> Mapping[str, Any]:
    found: Any = manifest.get("spec")
    for name in path:
        found = found.get(name) if isinstance(found, Mapping) else None
    return found if isinstance(found, Mapping) else {}


def _joined(manifest: Manifest) -> bool:
    return _part(manifest, "transport").get("type") in _JOINED


def _room(manifest: Manifest) -> tuple[object, object]:
    robot = _part(manifest, "robot")
    return robot.get("domainID", 0), robot.get("namespace", "/")


def _peers(manifest: Manifest) -> tuple[str, ...]:
    found = _part(manifest, "transport", "staticPeers").get("robot")
    return tuple(map(str, found)) if isinstance(found, tuple | list) else ()
