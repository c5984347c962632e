"""What the controller remembers of an object between two passes. Losing it costs reads, never correctness."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from robot_offload.decide.drift import Settled
from robot_offload.decide.ownership import Key
from robot_offload.decide.presence import Sighting


@dataclass(slots=True)
class Memory:
    """Of one RobotOffload, by its uid.

    Attributes:
        uid: whose memory it is; another uid under the same name starts anew.
        generation: the highest one seen: an answer with a lower one is stale.
        settled: what the API server made of manifests in its own way of writing.
        sighting: the robot's Lease.
        config_maps: names of the ConfigMaps of users that it reads.
        lease: what the robot's Lease said when it was last read (`presence.meaning`); None: there was none.
        versions: resourceVersion by uid of all that the last pass read or wrote: events about those are no news.
        status: what the metrics need of the status as it was last seen or written (`summary`).
    """

    uid: str
    generation: int = 0
    settled: dict[Key, Settled] = field(default_factory=dict)
    sighting: Sighting | None = None
    config_maps: frozenset[str] = frozenset()
    lease: tuple[Any, ...] | None = None
    versions: dict[str, str] = field(default_factory=dict)
    status: Mapping[str, Any] = field(default_factory=dict)


def summary(status: Mapping[str, Any]) -> dict[str, Any]:
    """The few words of a status that are kept: whole ones of hundreds of objects would be megabytes."""
    return {
        "placement": status.get("placement"),
        "robot": {"connected": bool((status.get("robot") or {}).get("connected"))},
        "conditions": tuple(
            {"type": condition["type"], "status": condition["status"]} for condition in status.get("conditions") or ()
        ),
    }
