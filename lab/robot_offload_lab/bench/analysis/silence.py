"""False takeovers by silence: on a link that is good enough all the time, how often a message is wrongly given up."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Final

from robot_offload_core.words.reasons import Reason
from robot_offload_lab.bench.analysis.alarms import QuietStretch, leaves
from robot_offload_lab.bench.analysis.share import cloud_share
from robot_offload_lab.bench.observed import only
from robot_offload_lab.bench.resource import BenchCase
from robot_offload_lab.bench.results import Figure, GroupResult, Priority
from robot_offload_lab.judge.measures import Interval
from robot_offload_lab.judge.recording import PlacementChange

GROUP: Final = "silence"
MUST_TAKEOVERS: Final = 2
REPORTED_MINUTES: Final = 60.0
"""The limit applies to this length of time."""


def outcome(priority: Priority, watched: Sequence[tuple[BenchCase, QuietStretch]]) -> GroupResult:
    """Return the figures of a watch of each case."""
    return GroupResult(
        group=GROUP,
        priority=priority,
        figures=tuple(figure for case, watch in watched for figure in _figures(case, watch)),
        parts=(),
        samples=tuple(
            {"command": case.name, "t_s": round(leave.t_s, 3), "reason": leave.reason}
            for case, watch in watched
            for leave in leaves(watch)
        ),
    )


def _figures(case: BenchCase, watch: QuietStretch) -> tuple[Figure, ...]:
    found = leaves(watch)
    by_silence = [leave for leave in found if leave.reason == Reason.OUTPUT_SILENT.value]
    others = Counter(leave.reason for leave in found if leave not in by_silence)
    minutes = watch.length_s / 60
    words = [f"besides, the robot took over {count} times by {reason}" for reason, count in sorted(others.items())]
    if minutes < REPORTED_MINUTES:
        words.append(f"the limit is for {REPORTED_MINUTES:g} minutes")
    share = cloud_share(only(PlacementChange, watch.robot), [Interval(watch.start_s, watch.end_s)])
    command = case.name.replace("-", " ")
    return (
        Figure(
            f"takeovers_{case.name}",
            f"False takeovers by silence in {minutes:.1f} minutes, Hot standby, command {command}", case.describe(),
            case.tolerance_ms, 1, len(by_silence), "alarms", MUST_TAKEOVERS, note="; ".join(words),
        ),
        Figure(
            f"cloud_share_{case.name}", f"Share of that time with the cloud in charge, command {command}",
            case.describe(), case.tolerance_ms, 1, None if share is None else share * 100, "%",
        ),
    )  # fmt: skip
