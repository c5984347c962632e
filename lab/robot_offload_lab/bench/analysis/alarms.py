"""False alarms: on a link that is good enough all the time, how often the robot takes over as if it were lost."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from robot_offload_lab.bench.analysis.share import MUST_SHARE, cloud_share
from robot_offload_lab.bench.observed import BeatHeard, Observation, only
from robot_offload_lab.bench.resource import BenchCase
from robot_offload_lab.bench.results import Figure, GroupResult, Priority, Sample, part, parts
from robot_offload_lab.judge.measures import Interval
from robot_offload_lab.judge.recording import PlacementChange

GROUP: Final = "alarms"
MUST_ALARMS: Final = 1
AIM_ALARMS: Final = 0
REPORTED_MINUTES: Final = 30.0
"""The limits are for so long."""


@dataclass(frozen=True)
class QuietStretch:
    """One stretch of observation, from start_s to end_s, by the witness on the robot."""

    start_s: float
    end_s: float
    robot: tuple[Observation, ...]

    @property
    def length_s(self) -> float:
        """How long it took."""
        return self.end_s - self.start_s


@dataclass(frozen=True)
class Leave:
    """The cloud was left, after a sudden loss (a false alarm) or by a decision of the latency rule."""

    t_s: float
    reason: str
    sudden: bool


def leaves(watch: QuietStretch) -> tuple[Leave, ...]:
    """Returns every time that the side in charge changed from cloud to robot."""
    placements = only(PlacementChange, watch.robot)
    return tuple(
        Leave(change.decided_s - watch.start_s, change.reason, change.detect_ms is not None)
        for before, change in itertools.pairwise(placements)
        if before.site == "cloud" and change.site == "robot" and watch.start_s <= change.decided_s <= watch.end_s
    )


def beat_gaps_ms(watch: QuietStretch) -> tuple[float, ...]:
    """Returns the distances of the cloud's beats as they reached the robot."""
    times = [heard.t_s for heard in only(BeatHeard, watch.robot) if watch.start_s <= heard.t_s <= watch.end_s]
    return tuple((after - before) * 1e3 for before, after in itertools.pairwise(times))


def outcome(case: BenchCase, priority: Priority, watches: Sequence[QuietStretch]) -> GroupResult:
    """Returns the figures of all stretches together."""
    found = [leaves(watch) for watch in watches]
    sudden = [leave for stretch in found for leave in stretch if leave.sudden]
    minutes = sum(watch.length_s for watch in watches) / 60
    shares = [cloud_share(only(PlacementChange, w.robot), [Interval(w.start_s, w.end_s)]) for w in watches]
    weighed = [share * w.length_s for share, w in zip(shares, watches, strict=True) if share is not None]
    total_s = sum(watch.length_s for watch in watches)
    moved = sum(not leave.sudden for stretch in found for leave in stretch)
    return GroupResult(
        group=GROUP,
        priority=priority,
        figures=(
            Figure(
                "false_alarms", f"False alarms in {minutes:.0f} minutes, data session busy", case.describe(),
                case.tolerance_ms, len(watches), len(sudden), "alarms", MUST_ALARMS, AIM_ALARMS,
                note=_note(sudden, moved, minutes),
            ),
            Figure(
                "cloud_share", "Share of the good time with the cloud in charge", case.describe(), case.tolerance_ms,
                len(watches), sum(weighed) / total_s * 100 if weighed else None, "%", MUST_SHARE * 100, at_least=True,
            ),
        ),
        parts=parts([part("distance of two beats at the robot", "ms", _all_gaps(watches))]),
        samples=tuple(_samples(found)),
    )  # fmt: skip


def _note(sudden: Sequence[Leave], moved: int, minutes: float) -> str:
    reasons = Counter(leave.reason for leave in sudden)
    words = [f"{count} {reason}" for reason, count in reasons.items()]
    if moved:
        words.append(f"besides, the latency rule moved to the robot {moved} times")
    if minutes < REPORTED_MINUTES:
        words.append(f"the limits are for {REPORTED_MINUTES:g} minutes")
    return "; ".join(words)


def _all_gaps(watches: Sequence[QuietStretch]) -> Iterator[float]:
    for watch in watches:
        yield from beat_gaps_ms(watch)


def _samples(found: Sequence[Sequence[Leave]]) -> Iterator[Sample]:
    for number, stretch in enumerate(found, start=1):
        for leave in stretch:
            yield {"stretch": number, "t_s": round(leave.t_s, 3), "reason": leave.reason, "sudden": leave.sudden}
