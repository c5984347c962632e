"""On a computer that is too busy for both sides, time says nothing about the switch; all else does."""

from __future__ import annotations

from typing import Any

import pytest

from robot_offload_lab.judge.busy import TIMING, UNKNOWN, Computer, busy, counted
from robot_offload_lab.judge.invariants import Violation
from robot_offload_lab.judge.measures import measure
from robot_offload_lab.judge.recording import Record
from robot_offload_lab.judge.report import build
from robot_offload_lab.judge.untried import untried
from tests.unit.lab.judge.recordings import calm_run, placement, recording


def starving(times: int, reason: str = "ControlStarved") -> list[Record]:
    """A calm run in which the robot says so often that its control process missed its processor."""
    return [*calm_run(), *(placement(2.0 + 0.1 * number, "cloud", 2, reason) for number in range(times))]


def silent(records: list[Record]) -> list[Record]:
    """The same run, in which nothing arrived for two seconds."""
    return [record for record in records if not 1012.0 < getattr(record, "t_s", 0.0) < 1014.0]


def report_of(records: list[Record], computer: Computer = UNKNOWN) -> dict[str, Any]:
    return build(measure(recording(records)), None, computer)


@pytest.mark.parametrize(
    ("records", "computer", "told"),
    [
        (calm_run(), UNKNOWN, ""),
        (calm_run(), Computer(0.89, 0.1), ""),
        (starving(4), UNKNOWN, ""),
        (starving(5), UNKNOWN, "the agents missed their processor 5 times"),
        (starving(5, "CloudControlSilent"), UNKNOWN, "the agents missed their processor 5 times"),
        (calm_run(), Computer(0.9), "90% of its cores were in use"),
        (calm_run(), Computer(0.1, 0.25), "it stood still for 250 ms"),
        (starving(9), Computer(1.0, 0.25), "9 times, 100% of its cores were in use, it stood still for 250 ms"),
    ],
)
def test_a_computer_is_busy_by_the_agents_own_words_its_cores_or_its_standstill(
    records: list[Record], computer: Computer, told: str
) -> None:
    why = busy(recording(records), computer)
    assert bool(why) == bool(told)
    assert why.endswith(told)


def test_on_a_busy_computer_promises_of_time_are_left_out_and_no_other() -> None:
    kinds = (
        "Duplicate",
        "Reordered",
        "Interleaved",
        "Stale",
        "Gap",
        "Lost",
        "Epoch",
        "GoalTwice",
        "GoalGap",
        "GoalLost",
    )
    found = [Violation(1.0, kind, "") for kind in kinds]
    assert [each.kind for each in counted(found, "busy")] == [kind for kind in kinds if kind not in TIMING]
    assert list(counted(found, "")) == found
    assert {"Duplicate", "Reordered", "Interleaved", "Epoch", "Unused", "GoalTwice", "GoalLost"}.isdisjoint(TIMING)


def test_a_silence_counts_on_a_calm_computer_and_is_shown_apart_on_a_busy_one() -> None:
    calm = report_of(silent(calm_run()))
    assert {each["kind"] for each in calm["violations"]} == {"Gap"}
    assert (calm["busy"], calm["excused"]) == ("", [])
    busied = report_of(silent(calm_run()), Computer(0.97))
    assert (busied["violations"], busied["excused"]) == ([], calm["violations"])
    assert "1 that it explains is left out (Gap)" in next(untried(busied))


def test_a_busy_computer_is_named_although_every_promise_was_kept() -> None:
    sentence = next(untried(report_of(calm_run(), Computer(0.97))))
    assert "97% of its cores were in use" in sentence
    assert "every promise was kept all the same" in sentence
