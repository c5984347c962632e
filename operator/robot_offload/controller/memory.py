"""What the controller remembers of an object between two passes. Losing it costs requests, never correctness."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from robot_offload.decide.plan import History
from robot_offload.decide.presence import Sighting

EVENTS_AT_ONCE: Final = 25
EVENT_EVERY_S: Final = 300.0
"""How many Events one object may post: the limits of client-go (defaultSpamBurst, defaultSpamQPS)."""


@dataclass(slots=True)
class Allowance:
    """A bucket of tokens: so many at once, and one more after each period.

    Attributes:
        left: tokens in the bucket.
        filled_s: when the bucket was last filled, on the steady clock.
    """

    left: float = EVENTS_AT_ONCE
    filled_s: float | None = None

    def take(self, now_s: float) -> bool:
        """Takes one token; returns whether there was one."""
        passed_s = now_s - (now_s if self.filled_s is None else self.filled_s)
        self.left = min(float(EVENTS_AT_ONCE), self.left + passed_s / EVENT_EVERY_S)
        self.filled_s = now_s
        if self.left < 1.0:
            return False
        self.left -= 1.0
        return True


@dataclass(slots=True)
class Memory:
    """What is remembered of one RobotOffload, by its uid.

    Attributes:
        uid: whose memory it is; another uid under the same name starts anew.
        history: what earlier passes have learnt about the children.
        sighting: the robot's Lease.
        config_maps: names of the ConfigMaps of users that it reads.
        lease: what the robot's Lease said when it was last read (`presence.meaning`); None: there was none.
        versions: resourceVersion by uid of all that the last pass read or wrote: events about those are no news.
        status: what the metrics need of the status as it was last seen or written (`summary`).
        refusals: what the API server refused for good in the last pass; the same again is not worth a retry.
        failures: passes in a row that a step has broken off.
        events: how many more Events may be posted.
    """

    uid: str
    history: History = field(default_factory=History)
    sighting: Sighting | None = None
    config_maps: frozenset[str] = frozenset()
    lease: tuple[Any, ...] | None = None
    versions: dict[str, str] = field(default_factory=dict)
    status: Mapping[str, Any] = field(default_factory=dict)
    refusals: frozenset[str] = frozenset()
    failures: int = 0
    events: Allowance = field(default_factory=Allowance)


def summary(status: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the few words of a status that are kept: whole ones of hundreds of objects would be megabytes."""
    return {
        "placement": status.get("placement"),
        "robot": {"connected": bool((status.get("robot") or {}).get("connected"))},
        "conditions": tuple(
            {"type": condition["type"], "status": condition["status"]} for condition in status.get("conditions") or ()
        ),
    }
