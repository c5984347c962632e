"""The numbers of one side's agent in the state file: the cloud's own, and those that the robot has sent.

Read without trust and part by part: a part of another form is left out and counted, the others stand.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, TypeVar

from robot_offload.api.printable import printable

LATENCY_S: Final = (0.005, 0.01, 0.015, 0.02, 0.03, 0.05, 0.075, 0.1, 0.15, 0.2, 0.3, 0.5, 1.0)
"""Bounds of the histogram of round trips, as the agent counts them (`tallies.LATENCY_MS`)."""
GAP_S: Final = (0.025, 0.05, 0.075, 0.1, 0.125, 0.15, 0.2, 0.3, 0.5, 1.0, 2.0)
"""Bounds of the histogram of the time between commands (`tallies.GAP_MS`)."""
MAX_ENTRIES: Final = 64
"""Of each table; the agent sends 32 at most."""
MAX_NAME: Final = 253
_WORD: Final = re.compile(r"[A-Za-z][A-Za-z_]{0,63}")
_MOST: Final = 2**53
Value = TypeVar("Value")


@dataclass(frozen=True, slots=True)
class Histogram:
    """Counts of values by bound, not added up, the last one without a bound, and the sum of all values in seconds."""

    counts: tuple[int, ...]
    sum_s: float


@dataclass(frozen=True, slots=True)
class SideNumbers:
    """What one side's agent counts since its start. None and empty: it has not said.

    Attributes:
        ready: whether this side's CORE nodes are Active or stand by.
        latency_s, loss_share: of the link as of now.
        clock_offset_s: the other side's system clock minus this one's.
        beats_received, beats_lost: of the other side.
        latency: round trips.
        changeovers: number by (side that took over, reason).
        losses, false_alarms, silence_s: sudden losses of the cloud, those that were none, time without a good beat.
        gaps: time between two commands, by output.
        overdue_s: how long its commands were overdue, by output.
        topics: messages by topic and what became of them.
        refused: messages of the cloud by reason.
        goals: by action and outcome.
        actions: by action: goals that a side executes now, goals that wait for one, restarts since the relay's start.
        services: calls that are not answered yet, by service.
        used_goals, used_calls: of the group's nodes at servers outside, that have not ended yet.
        processes: processor time in seconds, resident bytes and deaths by process.
        states: age of the state in seconds with which this side went on at its last change.
        garbage_reports: reports of the robot that were none (cloud only).
        left_out: entries that had no room.
        garbage: parts here that could not be read.
    """

    ready: bool | None = None
    latency_s: float | None = None
    loss_share: float | None = None
    clock_offset_s: float | None = None
    beats_received: int | None = None
    beats_lost: int | None = None
    latency: Histogram | None = None
    changeovers: tuple[tuple[str, str, int], ...] = ()
    losses: int | None = None
    false_alarms: int | None = None
    silence_s: float | None = None
    gaps: tuple[tuple[str, Histogram], ...] = ()
    overdue_s: tuple[tuple[str, float], ...] = ()
    topics: tuple[tuple[str, tuple[int, ...]], ...] = ()
    refused: tuple[tuple[str, int], ...] = ()
    goals: tuple[tuple[str, tuple[int, ...]], ...] = ()
    actions: tuple[tuple[str, tuple[int, ...]], ...] = ()
    services: tuple[tuple[str, int], ...] = ()
    used_goals: int | None = None
    used_calls: int | None = None
    processes: tuple[tuple[str, tuple[int, ...]], ...] = ()
    states: tuple[tuple[str, int], ...] = ()
    garbage_reports: int | None = None
    left_out: int = 0
    garbage: int = 0


FATES: Final = ("sent", "rate_limited", "thinned", "unsent")
"""What becomes of a message of an input, in the order of `topics`."""
OUTCOMES: Final = ("succeeded", "aborted", "canceled")
"""How a goal ends, in the order of `goals`."""
IN_FLIGHT: Final = ("executing", "waiting", "restarts")
"""What is said of an action's goals, in the order of `actions`."""


class _BadPartError(ValueError):
    """A part has another form."""


def parse_numbers(said: object) -> SideNumbers | None:
    """Return the numbers of a side; None: it has said nothing. What cannot be read is counted, nothing is raised."""
    if not isinstance(said, Mapping):
        return None
    reader = _Reader(said)
    beats = reader.part("beats", lambda value: _counts(value, 2)) or (None, None)
    losses = reader.part("losses", lambda value: _counts(value, 3)) or (None, None, None)
    used = reader.part("used", lambda value: _counts(value, 2)) or (None, None)
    gaps = reader.table("gaps", lambda value: _counts(value, len(GAP_S) + 3))
    return SideNumbers(
        ready=reader.part("ready", _truth),
        latency_s=_seconds(reader.part("latency_ms", _number)),
        loss_share=reader.part("loss_share", _number),
        clock_offset_s=_seconds(reader.part("clock_offset_ms", _number)),
        beats_received=beats[0],
        beats_lost=beats[1],
        latency=reader.part("latency", _latency),
        changeovers=reader.part("changeovers", _changeovers) or (),
        losses=losses[0],
        false_alarms=losses[1],
        silence_s=_seconds(losses[2]),
        gaps=tuple((name, Histogram(counts[2:], counts[1] / 1e3)) for name, counts in gaps),
        overdue_s=tuple((name, counts[0] / 1e3) for name, counts in gaps),
        topics=reader.table("topics", lambda value: _counts(value, len(FATES))),
        refused=tuple((name, count) for name, count in reader.table("refused", _count) if _WORD.fullmatch(name)),
        goals=reader.table("goals", lambda value: _counts(value, len(OUTCOMES))),
        actions=reader.table("actions", lambda value: _counts(value, len(IN_FLIGHT))),
        services=reader.table("services", _count),
        used_goals=used[0],
        used_calls=used[1],
        processes=reader.table("processes", lambda value: _counts(value, 3)),
        states=reader.table("states", _count),
        garbage_reports=reader.part("garbage_reports", _count),
        left_out=reader.part("left_out", _count) or 0,
        garbage=reader.garbage,
    )


class _Reader:
    """Reads one part after the other; `garbage` counts those of another form."""

    def __init__(self, said: Mapping[str, Any]) -> None:
        self._said = said
        self.garbage = 0

    def part(self, name: str, read: Callable[[Any], Value]) -> Value | None:
        """Return a part; None: it is not there, or has another form."""
        value = self._said.get(name)
        if value is None:
            return None
        try:
            return read(value)
        except _BadPartError:
            self.garbage += 1
            return None

    def table(self, name: str, read: Callable[[Any], Value]) -> tuple[tuple[str, Value], ...]:
        """Return a bounded table by name; nothing of it when one entry has another form."""

        def entries(value: object) -> tuple[tuple[str, Value], ...]:
            if not isinstance(value, Mapping):
                raise _BadPartError
            return tuple(
                (printable(str(key)[:MAX_NAME]), read(entry)) for key, entry in list(value.items())[:MAX_ENTRIES]
            )

        return self.part(name, entries) or ()


def _truth(value: object) -> bool:
    if not isinstance(value, bool):
        raise _BadPartError
    return value


def _number(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < _MOST or math.isnan(value):
        raise _BadPartError
    return float(value)


def _count(value: object) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= _MOST:
        raise _BadPartError
    return value


def _counts(value: object, number: int) -> tuple[int, ...]:
    if not isinstance(value, list) or len(value) != number:
        raise _BadPartError
    return tuple(_count(each) for each in value)


def _latency(value: object) -> Histogram:
    sum_ms, *counts = _counts(value, len(LATENCY_S) + 2)
    return Histogram(tuple(counts), sum_ms / 1e3)


def _changeovers(value: object) -> tuple[tuple[str, str, int], ...]:
    if not isinstance(value, list):
        raise _BadPartError
    found = []
    for entry in value[:MAX_ENTRIES]:
        if not isinstance(entry, list) or len(entry) != 3:
            raise _BadPartError
        site, reason, count = entry
        if site not in ("robot", "cloud") or not isinstance(reason, str) or not _WORD.fullmatch(reason):
            raise _BadPartError
        found.append((site, reason, _count(count)))
    return tuple(found)


def _seconds(value_ms: float | None) -> float | None:
    return None if value_ms is None else value_ms / 1e3
