"""The last change of side in the robot's report: a silence is said of the change that it belongs to, or not at all."""

from __future__ import annotations

import pytest

from robot_offload_agent.control.numbers import changeover
from robot_offload_core.fence.token import Site

LAST = (100.0, "robot", "HeartbeatLost")


def test_before_the_first_change_there_is_none() -> None:
    assert changeover(None, (Site.ROBOT, 99.9, 140.0), 110.0) is None


@pytest.mark.parametrize("at_s", [99.8, 100.0, 103.0])  # the collector may fall back before control decides
def test_the_silence_is_that_of_the_collectors_change_to_the_same_side(at_s: float) -> None:
    found = changeover(LAST, (Site.ROBOT, at_s, 140.0), 110.04)
    assert found == {"to": "robot", "reason": "HeartbeatLost", "ago_s": 10.0, "gap_ms": 140.0}


@pytest.mark.parametrize("silence", [None, (Site.CLOUD, 99.9, 140.0), (Site.ROBOT, 60.0, 140.0)])
def test_an_earlier_silence_is_not_said_of_a_later_change(silence: tuple[Site, float, float] | None) -> None:
    found = changeover(LAST, silence, 110.0)
    assert found is not None
    assert found["gap_ms"] is None
