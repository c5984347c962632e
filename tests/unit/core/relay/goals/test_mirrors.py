"""Goals that run at the Hot standby too (handover, rule 9)."""

from __future__ import annotations

import pytest

from robot_offload_core.fence.token import Site
from robot_offload_core.relay.goals.ports import GoalStatus
from robot_offload_core.relay.process import RelayPlan
from robot_offload_core.words.declared import ActionSpec, OnSwitch
from tests.unit.core.relay.goals.pair import FOLLOW, Pair, Side

SPEC = ActionSpec(
    FOLLOW, "nav2_msgs/action/FollowPath", OnSwitch.RESEND, "controller", mirror=True, core=True, hot=tuple(Site)
)
PLAN = RelayPlan(actions=(SPEC,))


def sides(pair: Pair, holder: Site) -> tuple[Side, Side]:
    return (pair.robot, pair.cloud) if holder is Site.ROBOT else (pair.cloud, pair.robot)


def on(holder: Site) -> tuple[Pair, Side, Side]:
    pair = Pair(PLAN)
    if holder is Site.CLOUD:
        pair.in_cloud()
    return pair, *sides(pair, holder)


@pytest.mark.parametrize("holder", list(Site))
def test_a_live_goal_runs_on_both_sides_and_the_client_hears_the_holder(holder: Site) -> None:
    pair, acting, standby = on(holder)
    wants = pair.goal(1)
    assert len(acting.offered) == len(standby.offered) == 1
    standby.feed(0, b"mirror")
    acting.feed(0, b"holder")
    assert [words[20:] for words in pair.robot.feedback] == [b"holder"]
    pair.run(3.0)
    assert not standby.cancelled, "a mirror needs no lease"
    acting.end(0)
    assert pair.result_of(wants) == [GoalStatus.SUCCEEDED]
    pair.run(0.1)
    assert set(standby.cancelled) == set(standby.offered)


@pytest.mark.parametrize("holder", list(Site))
def test_a_mirror_goes_on_as_the_holders_copy_after_a_change(holder: Site) -> None:
    pair, acting, standby = on(holder)
    wants = pair.goal(1)
    pair.prepare(holder.other, 5)
    assert not pair.robot.statuses[-1].pending
    pair.change(holder.other, 5)
    pair.run(3.0)
    assert len(acting.offered) == len(standby.offered) == 1, "no goal begins anew"
    assert not acting.cancelled, "the old side's copy is the mirror now"
    standby.feed(0, b"went on")
    assert pair.robot.feedback[-1][20:] == b"went on"
    standby.end(0)
    assert pair.result_of(wants) == [GoalStatus.SUCCEEDED]


def test_a_mirror_takes_over_after_a_loss() -> None:
    pair, acting, standby = on(Site.CLOUD)
    wants = pair.goal(1)
    pair.lose = {Site.ROBOT, Site.CLOUD}
    pair.change(Site.ROBOT, 5, sudden=True)
    standby.feed(0, b"at once")
    assert pair.robot.feedback[-1][20:] == b"at once"
    assert len(standby.offered) == 1
    standby.end(0)
    assert pair.result_of(wants) == [GoalStatus.SUCCEEDED]
    pair.lose = set()
    pair.run(1.5)
    assert set(acting.cancelled) == set(acting.offered)


def test_the_end_of_a_mirror_is_nobodys_result_and_makes_its_side_unfit_after_a_second() -> None:
    pair, acting, standby = on(Site.CLOUD)
    wants = pair.goal(1)
    standby.end(0, GoalStatus.ABORTED)
    pair.run(0.5)
    assert pair.result_of(wants) == []
    assert not pair.robot.statuses[-1].unfit
    pair.run(0.7)
    assert pair.robot.statuses[-1].unfit
    assert len(standby.offered) == 1, "it is not begun again beside a copy that has gone on"
    acting.end(0)
    pair.run(0.2)
    assert not pair.robot.statuses[-1].unfit


def test_a_mirror_that_ended_does_not_keep_its_side_from_taking_the_goal_over() -> None:
    pair, _, standby = on(Site.CLOUD)
    wants = pair.goal(1)
    standby.end(0, GoalStatus.SUCCEEDED)
    pair.run(2.0)
    pair.change(Site.ROBOT, 5, sudden=True)
    assert len(standby.offered) == 2
    standby.end(1)
    assert pair.result_of(wants) == [GoalStatus.SUCCEEDED]


def test_only_a_hot_side_has_mirrors() -> None:
    plan = RelayPlan(actions=(ActionSpec(**{**vars(SPEC), "hot": (Site.ROBOT,)}),))
    pair = Pair(plan)
    pair.goal(1)
    assert not pair.cloud.offered
    pair.in_cloud()
    pair.run(1.0)
    assert len(pair.robot.offered) == 1
    assert not pair.robot.cancelled


def test_mirrors_that_a_new_relay_of_the_robot_does_not_name_end() -> None:
    pair, _, standby = on(Site.ROBOT)
    pair.goal(1)
    pair.start_robot(journal=False)
    pair.run(3.0)
    assert not standby.cancelled
    pair.run(3.0)
    assert set(standby.cancelled) == set(standby.offered)


def test_a_successor_of_the_robots_relay_keeps_the_mirrors() -> None:
    pair, acting, standby = on(Site.CLOUD)
    wants = pair.goal(1)
    pair.start_robot()
    pair.run(7.0)
    assert len(acting.offered) == len(standby.offered) == 1
    assert not acting.cancelled
    acting.end(0)
    assert pair.result_of(wants) == [GoalStatus.SUCCEEDED]
