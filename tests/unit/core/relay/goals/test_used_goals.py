"""Goals of the group at actions outside it: whose are offered, and when the old side's end (handover, rule 11)."""

from __future__ import annotations

import pytest

from robot_offload_core.fence.token import Site
from robot_offload_core.relay.goals.ports import CancelCode, Face, GoalStatus
from robot_offload_core.relay.process import RelayPlan
from robot_offload_core.words.declared import UsedAction, UsedService
from tests.unit.core.relay.goals.pair import LIFT, Pair, Side, goal, goal_id

NOW, LATER = 0.0, 0.5


def send(side: Side, number: int, name: str = LIFT) -> bytes:
    """A node of a side's group sends a goal and asks for its result; returns the caller of that."""
    assert side.relay is not None
    side.relay.goal_requested(Face.GROUP, name, b"send %d" % number, goal(number))
    side.relay.result_requested(Face.GROUP, name, b"result %d" % number, goal_id(number))
    side.pair.settle()
    return b"result %d" % number


def results(side: Side) -> list[tuple[bytes, GoalStatus]]:
    return [(caller, status) for caller, status, _ in side.results]


@pytest.mark.parametrize("site", list(Site))
def test_a_goal_of_the_holder_is_executed_outside_and_its_client_hears_all_of_it(site: Site) -> None:
    pair = Pair()
    if site is Site.CLOUD:
        pair.in_cloud()
    side = pair.robot if site is Site.ROBOT else pair.cloud
    caller = send(side, 1)
    assert side.accepted == [(b"send 1", True)]
    assert pair.robot.offered == [goal_id(1)]
    pair.robot.feed(0, b"half", Face.PUBLIC)
    assert side.feedback == [goal(1, b"half").replace(b"\0\1\0\0", bytes(4), 1)]
    assert side.shown[LIFT][0].status is GoalStatus.EXECUTING
    pair.robot.end(0, words=b"up", face=Face.PUBLIC)
    assert results(side) == [(caller, GoalStatus.SUCCEEDED)]
    assert side.results[0][2].endswith(b"up")


def test_a_goal_of_a_standby_is_refused_at_once() -> None:
    pair = Pair()
    send(pair.cloud, 1)
    assert pair.cloud.accepted == [(b"send 1", False)]
    pair.in_cloud()
    send(pair.robot, 2)
    assert pair.robot.accepted == [(b"send 2", False)]
    assert not pair.robot.offered


def test_a_goal_of_a_side_that_gets_ready_is_accepted_and_offered_after_the_changeover() -> None:
    pair = Pair()
    pair.prepare(Site.CLOUD, 2)
    send(pair.cloud, 1)
    pair.run(0.3)
    assert pair.cloud.accepted == [(b"send 1", True)]
    assert not pair.robot.offered
    pair.change(Site.CLOUD, 2)
    assert pair.robot.offered == [goal_id(1)]


def test_a_waiting_goal_ends_aborted_when_the_preparation_is_called_off_or_takes_too_long() -> None:
    pair = Pair()
    pair.prepare(Site.CLOUD, 2)
    first = send(pair.cloud, 1)
    pair.run(2.1)
    second = send(pair.cloud, 2)
    pair.candidate = None
    pair.run(0.1)
    assert results(pair.cloud) == [(first, GoalStatus.ABORTED), (second, GoalStatus.ABORTED)]
    assert not pair.robot.offered


@pytest.mark.parametrize("after_s", [NOW, LATER])
def test_the_old_sides_goal_is_cancelled_after_its_time(after_s: float) -> None:
    action = UsedAction(LIFT, "test_msgs/action/Fibonacci", "controller", cancel_after_s=after_s)
    pair = Pair(RelayPlan(used_actions=(action,)))
    caller = send(pair.robot, 1)
    pair.in_cloud()
    assert pair.robot.cancelled == ([goal_id(1)] if after_s == NOW else [])
    pair.run(0.5)
    assert goal_id(1) in pair.robot.cancelled
    pair.robot.end(0, GoalStatus.CANCELED, face=Face.PUBLIC)
    assert results(pair.robot) == [(caller, GoalStatus.ABORTED)], "its client asked for no cancel"


def test_the_new_sides_first_accepted_goal_ends_the_old_ones_earlier() -> None:
    pair = Pair()
    send(pair.robot, 1)
    pair.robot.auto = False
    pair.prepare(Site.CLOUD, 2)
    send(pair.cloud, 2)
    pair.change(Site.CLOUD, 2)
    assert pair.robot.offered == [goal_id(1), goal_id(2)]
    pair.run(0.1)
    assert not pair.robot.cancelled
    pair.relay.offer_answered(Face.PUBLIC, LIFT, goal_id(2), True)
    pair.settle()
    assert pair.robot.cancelled == [goal_id(1)]


def test_a_goal_of_an_earlier_stay_is_cancelled_even_when_its_side_holds_again() -> None:
    pair = Pair()
    send(pair.robot, 1)
    pair.in_cloud()
    pair.change(Site.ROBOT, 3)
    pair.run(0.6)
    assert set(pair.robot.cancelled) == {goal_id(1)}


def test_a_client_cancels_its_goal_before_and_after_it_was_offered() -> None:
    pair = Pair()
    pair.prepare(Site.CLOUD, 2)
    waits = send(pair.cloud, 1)
    cloud, relay = pair.cloud.relay, pair.relay
    assert cloud is not None
    cloud.cancel_requested(Face.GROUP, LIFT, b"c", goal_id(1), 0)
    pair.settle()
    assert pair.cloud.cancels[-1][0] is CancelCode.NONE
    assert results(pair.cloud) == [(waits, GoalStatus.CANCELED)]
    pair.candidate = None
    runs = send(pair.robot, 2)
    relay.cancel_requested(Face.GROUP, LIFT, b"c", goal_id(2), 0)
    pair.settle()
    assert pair.robot.cancelled == [goal_id(2)]
    pair.robot.end(0, GoalStatus.CANCELED, face=Face.PUBLIC)
    assert results(pair.robot) == [(runs, GoalStatus.CANCELED)]
    relay.cancel_requested(Face.GROUP, LIFT, b"c", goal_id(2), 0)
    relay.cancel_requested(Face.GROUP, LIFT, b"c", goal_id(9), 0)
    pair.settle()
    assert [code for code, _ in pair.robot.cancels[-2:]] == [CancelCode.TERMINATED, CancelCode.UNKNOWN_GOAL]


def test_after_a_loss_goals_of_the_robot_wait_until_its_effects_are_admitted() -> None:
    pair = Pair()
    pair.in_cloud()
    send(pair.cloud, 1)
    pair.change(Site.ROBOT, 3, sudden=True)
    pair.effects = None
    pair.run(0.05)
    send(pair.robot, 2)
    pair.run(0.2)
    assert pair.robot.offered == [goal_id(1)]
    pair.effects = Site.ROBOT
    pair.run(0.05)
    assert pair.robot.offered == [goal_id(1), goal_id(2)]
    assert goal_id(1) in pair.robot.cancelled


def test_a_server_that_refuses_or_never_answers_ends_the_goal_aborted() -> None:
    pair = Pair()
    pair.robot.auto = False
    refused = send(pair.robot, 1)
    pair.relay.offer_answered(Face.PUBLIC, LIFT, goal_id(1), False)
    pair.settle()
    silent = send(pair.robot, 2)
    pair.run(2.1)
    assert results(pair.robot) == [(refused, GoalStatus.ABORTED), (silent, GoalStatus.ABORTED)]
    pair.relay.offer_answered(Face.PUBLIC, LIFT, goal_id(2), True)
    pair.settle()
    assert pair.robot.cancelled == [goal_id(2)], "accepted too late, so it ends as soon as that is known"


def test_goals_wait_for_their_server_to_be_seen() -> None:
    pair = Pair()
    pair.see(pair.robot, "")
    send(pair.robot, 1)
    pair.run(0.2)
    assert not pair.robot.offered
    pair.see(pair.robot)
    pair.run(0.05)
    assert pair.robot.offered == [goal_id(1)]


@pytest.mark.parametrize("site", list(Site))
def test_a_successor_of_the_robots_relay_goes_on_with_goals_of_both_sides(site: Site) -> None:
    pair = Pair()
    if site is Site.CLOUD:
        pair.in_cloud()
    side = pair.robot if site is Site.ROBOT else pair.cloud
    caller = send(side, 1)
    pair.start_robot()
    pair.run(0.3)
    assert pair.robot.offered == [goal_id(1)], "nothing is offered twice"
    assert pair.robot.results_asked[-1] == goal_id(1)
    assert not pair.robot.cancelled
    pair.robot.end(0, face=Face.PUBLIC)
    assert results(side) == [(caller, GoalStatus.SUCCEEDED)]


def test_a_successor_without_the_journal_still_tells_the_cloud_what_became_of_its_goal() -> None:
    pair = Pair()
    pair.in_cloud()
    caller = send(pair.cloud, 1)
    pair.start_robot(journal=False)
    pair.run(0.3)
    assert not pair.robot.cancelled
    pair.robot.end(0, face=Face.PUBLIC)
    assert results(pair.cloud) == [(caller, GoalStatus.SUCCEEDED)]


def test_goals_whose_clients_lost_their_relay_are_cancelled() -> None:
    """The cloud's relay has no journal: nobody would hear of the goal, and nobody could end it."""
    pair = Pair()
    pair.in_cloud()
    send(pair.cloud, 1)
    pair.start_cloud()
    pair.run(0.3)
    assert goal_id(1) in pair.robot.cancelled


def test_open_calls_of_the_robots_group_fail_when_its_relay_is_replaced() -> None:
    pair = Pair()
    pair.relay.called(Face.GROUP, "/lamp", b"caller", b"on")
    pair.settle()
    pair.start_robot()
    assert pair.robot.failures == [(b"caller", "RelayRestarted")]


def test_nodes_of_the_cloud_act_by_presence_whoever_holds() -> None:
    plan = RelayPlan(
        used_services=(UsedService("/lamp", "std_srvs/srv/SetBool", "planner", of_cloud=True),),
        used_actions=(UsedAction(LIFT, "test_msgs/action/Fibonacci", "planner", of_cloud=True),),
    )
    pair = Pair(plan)
    assert pair.cloud.relay is not None
    send(pair.cloud, 1)
    pair.cloud.relay.called(Face.GROUP, "/lamp", b"caller", b"on")
    pair.settle()
    assert pair.robot.offered == [goal_id(1)]
    assert len(pair.robot.calls) == 1
    pair.in_cloud()
    pair.run(1.0)
    assert not pair.robot.cancelled, "a change of the holder is none of theirs"
    pair.present = False
    pair.run(0.3)
    send(pair.cloud, 2)
    assert pair.cloud.accepted[-1] == (b"send 2", False)
