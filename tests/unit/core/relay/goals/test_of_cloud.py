"""Services and actions of nodes with placement Cloud: by presence, whoever holds; refused at once while it is away."""

from __future__ import annotations

import pytest

from robot_offload_core.fence.token import Site
from robot_offload_core.relay.goals.ports import GoalStatus
from robot_offload_core.relay.process import RelayPlan
from robot_offload_core.words.declared import ActionSpec, OnSwitch, ServiceMode, ServiceSpec
from tests.unit.core.relay.goals.pair import Pair, goal_id
from tests.unit.core.relay.goals.test_requests import answer

DETECT, SEARCH, ASK = "/detect", "/search", "/ask"
PLAN = RelayPlan(
    services=(
        ServiceSpec(DETECT, "std_srvs/srv/Trigger", "planner", of_cloud=True),
        ServiceSpec(ASK, "std_srvs/srv/Trigger", "planner", ServiceMode.IDEMPOTENT, of_cloud=True),
    ),
    actions=(ActionSpec(SEARCH, "test_msgs/action/Fibonacci", OnSwitch.ABORT, "planner", of_cloud=True),),
)


@pytest.mark.parametrize("holder", list(Site))
def test_the_clouds_node_answers_whoever_holds(holder: Site) -> None:
    pair = Pair(PLAN)
    if holder is Site.CLOUD:
        pair.in_cloud()
    caller, wants = pair.call(DETECT, 1), pair.goal(1, SEARCH)
    answer(pair.cloud)
    pair.cloud.feed(0, b"half")
    pair.cloud.end(0, words=b"found")
    assert pair.robot.answers == [(caller, b"done")]
    assert len(pair.robot.feedback) == 1
    assert pair.result_of(wants) == [GoalStatus.SUCCEEDED]


def test_changes_of_the_holder_mean_nothing_to_its_goals_and_calls() -> None:
    pair = Pair(PLAN)
    caller, wants = pair.call(DETECT, 1), pair.goal(1, SEARCH)
    pair.in_cloud()
    pair.change(Site.ROBOT, 3)
    pair.run(1.0)
    assert not pair.cloud.cancelled
    assert not pair.robot.failures
    assert not pair.cloud.statuses[-1].busy, "nothing here keeps duplicated nodes Active"
    answer(pair.cloud)
    pair.cloud.end(0)
    assert pair.robot.answers == [(caller, b"done")]
    assert pair.result_of(wants) == [GoalStatus.SUCCEEDED]


def test_while_the_cloud_is_away_calls_and_goals_are_refused_at_once() -> None:
    pair = Pair(PLAN)
    pair.lose = {Site.ROBOT, Site.CLOUD}
    pair.run(0.5)
    caller = pair.call(DETECT, 1)
    pair.goal(1, SEARCH)
    assert pair.robot.failures == [(caller, "CloudAway")]
    assert pair.robot.accepted == [(b"send 1", False)]


def test_a_cloud_that_goes_away_ends_what_runs() -> None:
    pair = Pair(PLAN)
    calls = [pair.call(DETECT, 1), pair.call(ASK, 2)]
    wants = pair.goal(1, SEARCH)
    pair.lose = {Site.ROBOT, Site.CLOUD}
    pair.run(0.5)
    assert pair.robot.failures == [(caller, "Unknown") for caller in calls]
    assert pair.result_of(wants) == [GoalStatus.ABORTED]
    pair.lose = set()
    pair.run(1.2)
    assert pair.cloud.cancelled, "its server is asked to end what nobody waits for"


def test_a_cancelled_goal_ends_canceled_though_its_cloud_is_away() -> None:
    pair = Pair(PLAN)
    wants = pair.goal(1, SEARCH)
    pair.lose = {Site.ROBOT, Site.CLOUD}
    pair.ask_cancel(1, SEARCH)
    pair.run(0.5)
    assert pair.result_of(wants) == [GoalStatus.CANCELED]


def test_without_presence_the_cloud_lets_its_node_do_nothing() -> None:
    """A call that was under way when the cloud lost its presence is refused there, and asked again while it may."""
    pair = Pair(PLAN)
    pair.present = False
    pair.run(0.05)
    caller = pair.call(DETECT, 1)
    pair.run(0.5)
    assert not pair.cloud.calls
    pair.present = True
    pair.run(0.1)
    answer(pair.cloud)
    assert pair.robot.answers == [(caller, b"done")]


def test_names_of_the_group_are_not_served_under_presence() -> None:
    """Presence is granted to a standby too: a duplicated node there must not act by that."""
    services = (*PLAN.services, ServiceSpec("/make_plan", "nav_msgs/srv/GetPlan", "controller"))
    pair = Pair(RelayPlan(services=services))
    pair.in_cloud()
    pair.granted = None
    pair.run(0.05)
    pair.call("/make_plan", 1)
    pair.run(0.3)
    assert not pair.cloud.calls
    assert goal_id(1) not in pair.cloud.offered
