"""The link fails in every way that a link can fail; the robot goes on and the consumer hears one side at a time."""

import pytest

from robot_offload_agent.runtime.clock import now_s
from tests.ros.agent.ears import wait_until
from tests.ros.agent.harness import World
from tests.ros.agent.passage import holes, longest_gap_s

GAP_LIMIT_S = 5.0
"""Generous: detection 150 ms + activation, on a machine that does other things as well."""


@pytest.mark.core
@pytest.mark.parametrize("which", ["both", "up", "down"])
def test_the_robot_takes_over_when_the_link_is_cut_and_gives_back_when_it_heals(world: World, which: str) -> None:
    at_s = world.cut(which)
    world.goes_to("robot")
    assert longest_gap_s(world.arrivals, at_s) < GAP_LIMIT_S
    lost = next(p for p in world.placed if p.t_s > at_s and p.site == "robot")
    assert lost.reason in ("HeartbeatLost", "EchoStale", "CloudNotActing", "LatencyTooHigh", "LinkUnsteady")
    world.cut(None)
    world.goes_to("cloud")


@pytest.mark.core
def test_nothing_old_passes_in_the_burst_after_a_cut(world: World) -> None:
    world.cut("down")
    world.goes_to("robot")
    wait_until(lambda: False, 0.3)
    since = len(world.arrivals)
    world.cut(None)
    world.goes_to("cloud")
    late = [a for a in world.arrivals[since:] if a.site == "cloud" and a.age_s > 0.4]
    assert not late, late


def test_a_slow_link_is_left_by_command_without_a_hole_and_taken_again_when_it_is_fast(world: World) -> None:
    assert world.wire is not None
    since, at_s = len(world.arrivals), now_s()
    world.wire.set(delay_ms=60)  # the loop of 120 ms is over the limit of 60 ms, yet no beat is lost
    world.goes_to("robot")
    assert longest_gap_s(world.arrivals, at_s) < GAP_LIMIT_S
    assert world.reason in ("LatencyTooHigh", "LinkUnsteady")  # the second when the first slow beat is overdue
    assert holes(world.arrivals[since:]) == 0
    world.wire.set(delay_ms=0)
    world.goes_to("cloud")


def test_the_robot_takes_over_when_the_ros_link_is_cut_and_gives_back_when_it_heals(ros_world: World) -> None:
    at_s = ros_world.cut("both")
    ros_world.goes_to("robot")
    assert longest_gap_s(ros_world.arrivals, at_s) < GAP_LIMIT_S
    ros_world.cut(None)
    ros_world.goes_to("cloud")
