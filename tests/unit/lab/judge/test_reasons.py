"""Why the robot acted, from the announcements that consumers heard."""

from __future__ import annotations

import pytest

from robot_offload_lab.judge.reasons import in_words, of_robot
from robot_offload_lab.judge.recording import Ending, PlacementChange, Recording
from tests.unit.lab.judge import recordings


def change(t_s: float, site: str, reason: str) -> PlacementChange:
    return PlacementChange(t_s=t_s, site=site, epoch=1, reason=reason, message="", detect_ms=None)  # type: ignore[arg-type]


def recorded(*changes: PlacementChange) -> Recording:
    run = recordings.RUN
    return Recording(run=run, outputs={}, placements=changes, outcome=Ending(run.start_s + 30.0))


def test_only_the_robots_stays_have_a_reason_and_what_goes_on_is_one_stretch() -> None:
    start_s = recordings.RUN.start_s
    found = of_robot(
        recorded(
            change(start_s - 1.0, "robot", "Starting"),
            change(start_s + 2.0, "cloud", "LinkGood"),
            change(start_s + 10.0, "robot", "HeartbeatLost"),
            change(start_s + 12.0, "robot", "HeartbeatLost"),
            change(start_s + 14.0, "robot", "LatencyTooHigh"),
        )
    )
    assert [(since - start_s, until - start_s, word) for since, until, word in found] == [
        (0.0, 2.0, "starting"),
        (10.0, 14.0, "heartbeat lost"),
        (14.0, pytest.approx(30.0), "latency too high"),
    ]


def test_reasons_are_words() -> None:
    assert in_words("CloudNotReady") == "cloud not ready"
