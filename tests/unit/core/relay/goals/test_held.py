"""A planned switch never costs a goal: which goals it waits for, and for how long."""

from __future__ import annotations

from robot_offload_core.fence.token import Site
from robot_offload_core.relay.goals.attempts import MOST_MOVES
from robot_offload_core.relay.goals.ports import GoalStatus
from robot_offload_core.relay.process import RelayPlan
from robot_offload_core.words.declared import WITHOUT_LIMIT_S, ActionSpec, OnSwitch
from tests.unit.core.relay.goals.pair import FOLLOW, Pair

PATROL = "/patrol"
DRIVE = "/drive_to"
PLAN = RelayPlan(
    actions=(
        ActionSpec(PATROL, "test_msgs/action/Fibonacci", OnSwitch.RESEND_ON_LOSS, "controller", core=True),
        ActionSpec(FOLLOW, "test_msgs/action/Fibonacci", OnSwitch.RESEND, "controller", core=True),
        ActionSpec(DRIVE, "test_msgs/action/Fibonacci", OnSwitch.CONTINUE, "controller", core=True),
    ),
)


def held(pair: Pair) -> tuple[str, float]:
    """What control hears last of goals that a planned switch waits for."""
    pair.run(0.2)
    status = pair.robot.statuses[-1]
    return status.hold, status.hold_for_s


def test_a_planned_switch_waits_without_limit_for_a_goal_that_is_resent_on_a_loss_only() -> None:
    pair = Pair(PLAN)
    assert held(pair) == ("", 0.0)
    wants = pair.goal(1, PATROL)
    assert held(pair) == (PATROL, WITHOUT_LIMIT_S)
    pair.robot.end(0)
    assert pair.result_of(wants) == [GoalStatus.SUCCEEDED]
    assert held(pair) == ("", 0.0)


def test_after_a_loss_such_a_goal_goes_on_at_the_other_side_and_has_one_result() -> None:
    pair = Pair(PLAN)
    pair.in_cloud()
    wants = pair.goal(1, PATROL)
    pair.change(Site.ROBOT, 3, sudden=True)
    pair.run(0.5)
    assert pair.result_of(wants) == []
    assert len(pair.robot.offered) == 1
    pair.robot.end(0)
    assert pair.result_of(wants) == [GoalStatus.SUCCEEDED]


def test_a_goal_that_began_anew_twice_keeps_its_side_until_it_ends() -> None:
    pair = Pair(PLAN)
    pair.goal(1)
    for move in range(MOST_MOVES):
        assert held(pair) == ("", 0.0)
        pair.change((Site.CLOUD, Site.ROBOT)[move % 2], 2 + move, sudden=bool(move % 2))
    assert held(pair) == (FOLLOW, WITHOUT_LIMIT_S)


def test_a_goal_that_names_a_place_moves_at_each_change() -> None:
    pair = Pair(PLAN)
    wants = pair.goal(1, DRIVE)
    for move in range(2 * MOST_MOVES):
        assert held(pair) == ("", 0.0)
        pair.change((Site.CLOUD, Site.ROBOT)[move % 2], 2 + move, sudden=bool(move % 2))
    assert held(pair) == ("", 0.0)
    pair.robot.end(-1)
    assert pair.result_of(wants) == [GoalStatus.SUCCEEDED]


def test_a_relay_that_is_started_anew_still_knows_how_often_a_goal_began_anew() -> None:
    pair = Pair(PLAN)
    pair.goal(1)
    for move in range(MOST_MOVES):
        pair.change((Site.CLOUD, Site.ROBOT)[move % 2], 2 + move, sudden=bool(move % 2))
        pair.run(0.5)
    pair.start_robot()
    pair.run(0.5)
    assert held(pair) == (FOLLOW, WITHOUT_LIMIT_S)
