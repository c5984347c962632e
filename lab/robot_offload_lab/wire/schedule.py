"""The state of the emulated link at each moment: parts in a row, pure and without a clock.

A `Schedule` is a row of parts: constant conditions, periodic ones (outages, slow phases) and the replay of
a trace. Until its clock is started the link is `quiet`.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

from robot_offload_lab.links.recorded import Trace
from robot_offload_lab.wire.model import CLEAR, LinkConditions, WireError

Pair = tuple[LinkConditions, LinkConditions]
"""The conditions of the directions up (robot to cloud) and down."""

BOTH_CLEAR: Pair = (CLEAR, CLEAR)
BOTH_CUT: Pair = (LinkConditions(cut=True), LinkConditions(cut=True))


class ScheduleError(WireError):
    """The schedule is not valid."""


class SchedulePart(Protocol):
    """One thing that happens to the link."""

    def at(self, t_s: float) -> Pair:
        """Return the conditions at `t_s` seconds of the schedule's clock."""

    def quiet(self) -> Pair:
        """Return the conditions before the clock starts: the usual path, without events."""

    def next_change_s(self, t_s: float) -> float | None:
        """Return when the next phase after `t_s` begins or ends; None if this part has no phases."""


@dataclass(frozen=True)
class Constant:
    """The same conditions all the time."""

    up: LinkConditions = CLEAR
    down: LinkConditions = CLEAR

    def at(self, t_s: float) -> Pair:
        """Return the conditions, at any time."""
        return self.up, self.down

    def quiet(self) -> Pair:
        """Return the same conditions."""
        return self.up, self.down

    def next_change_s(self, t_s: float) -> float | None:
        """Return None: the conditions never change."""
        return None


@dataclass(frozen=True)
class Periodic:
    """Conditions that hold for the last `length_s` of every `period_s`, so that the first phase comes late.

    Attributes:
        length_s: how long a phase lasts.
        period_s: from the beginning of one phase to the beginning of the next.
        up: conditions of that direction during a phase.
        down: conditions of that direction during a phase.
    """

    length_s: float
    period_s: float
    up: LinkConditions
    down: LinkConditions

    def __post_init__(self) -> None:
        if not (0 < self.length_s < self.period_s < math.inf):
            raise ScheduleError(
                f"a phase of {self.length_s:g} s every {self.period_s:g} s is impossible: "
                "it must last longer than 0 s and shorter than its period"
            )

    def at(self, t_s: float) -> Pair:
        """Return the conditions of a phase, or clear ones between phases."""
        return (self.up, self.down) if t_s >= self._begin_s(t_s) else BOTH_CLEAR

    def quiet(self) -> Pair:
        """Return clear conditions, as between phases."""
        return BOTH_CLEAR

    def next_change_s(self, t_s: float) -> float | None:
        """Return the beginning or the end of a phase."""
        begin_s = self._begin_s(t_s)
        return begin_s if t_s < begin_s else begin_s + self.length_s

    def _begin_s(self, t_s: float) -> float:
        cycle = math.floor(t_s / self.period_s)
        return cycle * self.period_s + (self.period_s - self.length_s)


def outage(length_s: float, period_s: float) -> Periodic:
    """Return both directions cut for `length_s` out of every `period_s`, first after `period_s - length_s`."""
    return Periodic(length_s, period_s, *BOTH_CUT)


def slow_phase(length_s: float, period_s: float, extra_round_trip_ms: float) -> Periodic:
    """Return a longer round trip for `length_s` out of every `period_s`, half of it in each direction."""
    slow = LinkConditions(delay_ms=extra_round_trip_ms / 2)
    return Periodic(length_s, period_s, slow, slow)


@dataclass(frozen=True)
class Replay:
    """A recorded link, from the beginning again when it ends; see `Trace.one_way_ms`."""

    trace: Trace

    def at(self, t_s: float) -> Pair:
        """Return half of the round trip each way, the remainder of a stall, or a cut where requests were lost."""
        delay_ms = self.trace.one_way_ms(t_s)
        if delay_ms is None:
            return BOTH_CUT
        here = LinkConditions(delay_ms=delay_ms)
        return here, here

    def quiet(self) -> Pair:
        """Return half of the median round trip each way."""
        here = LinkConditions(delay_ms=self.trace.median_ms / 2)
        return here, here

    def next_change_s(self, t_s: float) -> float | None:
        """Return None: a replay changes all the time."""
        return None


@dataclass(frozen=True)
class Schedule:
    """Parts in a row; itself such a part. `+` puts two schedules in a row."""

    parts: tuple[SchedulePart, ...] = ()

    def __add__(self, other: Schedule) -> Schedule:
        return Schedule(self.parts + other.parts)

    def at(self, t_s: float) -> Pair:
        """Return the conditions up and down at `t_s` seconds since the start."""
        return functools.reduce(_in_a_row, (part.at(t_s) for part in self.parts), BOTH_CLEAR)

    def quiet(self) -> Pair:
        """Return the conditions before the start: no outage, no slow phase, the median of a trace."""
        return functools.reduce(_in_a_row, (part.quiet() for part in self.parts), BOTH_CLEAR)

    def next_change_s(self, t_s: float) -> float | None:
        """Return when the next outage or slow phase after `t_s` begins or ends; None without any."""
        changes_s = [change_s for part in self.parts if (change_s := part.next_change_s(t_s)) is not None]
        return min(changes_s, default=None)

    def latency_ms(self, t_s: float) -> float | None:
        """Return the round trip of a packet sent at `t_s` and answered at once.

        Only the schedule itself counts: jitter, random losses and queueing are left out.

        Returns:
            Milliseconds; None when the packet or its answer meets a cut (or a loss of 100 %).
        """
        up, _ = self.at(t_s)
        if up.cut or up.loss >= 1:
            return None
        _, down = self.at(t_s + up.delay_ms / 1000)
        return None if down.cut or down.loss >= 1 else up.delay_ms + down.delay_ms

    def good_intervals(
        self, threshold_ms: float, duration_s: float, step_s: float = 0.01
    ) -> tuple[tuple[float, float], ...]:
        """Return when the round trip is at most `threshold_ms`, as (from, to) in seconds since the start.

        Found by looking every `step_s` and bisecting (to about 10 us) where the answer changes; a change that
        is over within one step may be missed.

        Args:
            threshold_ms: the longest round trip that counts as good.
            duration_s: how far to look, from 0.
            step_s: how closely to look.
        """
        intervals: list[tuple[float, float]] = []
        begin_s: float | None = None
        for t_s, good in self._changes(threshold_ms, duration_s, step_s):
            if good:
                begin_s = t_s
            elif begin_s is not None:
                intervals.append((begin_s, t_s))
                begin_s = None
        if begin_s is not None and begin_s < duration_s:
            intervals.append((begin_s, duration_s))
        return tuple(intervals)

    def _changes(self, threshold_ms: float, duration_s: float, step_s: float) -> Iterator[tuple[float, bool]]:
        """Yield the moments at which good becomes bad and back, the first at 0."""

        def good_at(t_s: float) -> bool:
            latency_ms = self.latency_ms(t_s)
            return latency_ms is not None and latency_ms <= threshold_ms

        good = good_at(0.0)
        yield 0.0, good
        for index in range(1, math.ceil(duration_s / step_s) + 1):
            t_s = min(index * step_s, duration_s)
            if good_at(t_s) == good:
                continue
            before_s, after_s = (index - 1) * step_s, t_s
            while after_s - before_s > 1e-5:
                middle_s = (before_s + after_s) / 2
                if good_at(middle_s) == good:
                    before_s = middle_s
                else:
                    after_s = middle_s
            good = not good
            yield after_s, good


def _in_a_row(first: Pair, second: Pair) -> Pair:
    return first[0].combined(second[0]), first[1].combined(second[1])
