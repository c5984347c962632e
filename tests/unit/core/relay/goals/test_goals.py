"""The goals of clients over changes of the holder: rules 1 to 12 of the handover, each with its number."""

from __future__ import annotations

import pytest

from robot_offload_core.fence.token import Site
from robot_offload_core.relay.goals.ports import CancelCode, Face, GoalStatus
from robot_offload_core.relay.robot import GOALS_PENDING
from tests.unit.core.relay.goals.pair import FOLLOW, SPIN, WAIT, Pair, goal, goal_id

SUCCEEDED, ABORTED, CANCELED = GoalStatus.SUCCEEDED, GoalStatus.ABORTED, GoalStatus.CANCELED


def test_a_goal_is_accepted_at_once_executed_by_the_robot_and_has_one_result() -> None:
    """Rule 1."""
    pair = Pair()
    wants = pair.goal(1)
    assert pair.robot.accepted == [(b"send 1", True)]
    assert len(pair.robot.offered) == 1
    assert pair.robot.offered[0] != goal_id(1)
    assert pair.robot.results_asked == pair.robot.offered
    pair.robot.end(0, SUCCEEDED, b"there")
    pair.robot.end(0, ABORTED)
    assert pair.robot.results == [(wants, SUCCEEDED, b"\0\1\0\0\x04there")]


def test_a_refusal_of_the_server_ends_a_goal_that_was_accepted_by_the_relay() -> None:
    """Rule 1: `accept: Relay`."""
    pair = Pair()
    pair.robot.auto = False
    wants = pair.goal(1)
    assert pair.robot.accepted == [(b"send 1", True)]
    pair.relay.offer_answered(Face.GROUP, FOLLOW, pair.robot.offered[0], False)
    assert pair.result_of(wants) == [ABORTED]


def test_with_accept_holder_the_client_hears_what_the_server_says() -> None:
    """Rule 1: `accept: Holder`."""
    pair = Pair()
    pair.robot.auto = False
    for number, said in ((1, True), (2, False)):
        pair.goal(number, WAIT)
        assert (b"send %d" % number, said) not in pair.robot.accepted
        pair.relay.offer_answered(Face.GROUP, WAIT, pair.robot.offered[-1], said)
        assert pair.robot.accepted[-1] == (b"send %d" % number, said)
    assert [entry.goal_id for entry in pair.robot.shown[WAIT]] == [goal_id(1)]


def test_a_candidate_gets_the_live_goals_first_and_the_client_hears_only_the_holder() -> None:
    """Rules 2, 3 and 5: the copy that was accepted goes on, the robot's is cancelled, the handle stays."""
    pair = Pair()
    wants = pair.goal(1)
    pair.robot.feed(0, b"r1")
    pair.candidate = (Site.CLOUD, pair.holding.token)
    pair.prepare(Site.CLOUD, 2)
    assert len(pair.cloud.offered) == 1
    assert pair.robot.statuses[-1].pending == ()
    pair.cloud.feed(0, b"c1")
    pair.robot.feed(0, b"r2")
    pair.change(Site.CLOUD, 2)
    assert pair.robot.cancelled == pair.robot.offered
    pair.robot.feed(0, b"r3")
    pair.cloud.feed(0, b"c2")
    assert [words[20:] for words in pair.robot.feedback] == [b"r1", b"r2", b"c2"]
    assert all(words[4:20] == goal_id(1) for words in pair.robot.feedback)
    pair.robot.end(0, CANCELED)
    assert pair.result_of(wants) == []
    pair.cloud.end(0)
    assert pair.result_of(wants) == [SUCCEEDED]
    assert pair.relay.counters[f"{FOLLOW}.resent"] == 1


def test_the_candidate_is_not_ready_before_it_has_accepted_the_goals_in_their_order() -> None:
    """Rule 2 and section 8."""
    pair = Pair()
    pair.goal(1)
    pair.goal(2)
    pair.cloud.auto = False
    pair.prepare(Site.CLOUD, 2)
    assert pair.robot.statuses[-1].pending[0][0] == GOALS_PENDING
    relay = pair.cloud.relay
    assert relay is not None
    relay.offer_answered(Face.GROUP, FOLLOW, pair.cloud.offered[0], True)
    pair.settle()
    assert pair.robot.statuses[-1].pending
    relay.offer_answered(Face.GROUP, FOLLOW, pair.cloud.offered[1], True)
    pair.settle()
    assert not pair.robot.statuses[-1].pending
    order = [pair.relay.ledger.index[attempt] for attempt in pair.cloud.offered]
    assert order == [goal_id(1), goal_id(2)]


def test_a_copy_that_is_refused_or_ends_is_offered_again_until_the_change() -> None:
    """Rule 2."""
    pair = Pair()
    wants = pair.goal(1)
    pair.prepare(Site.CLOUD, 2)
    pair.cloud.end(0, SUCCEEDED)
    pair.run(0.3)
    assert len(pair.cloud.offered) == 1
    pair.run(0.4)
    assert len(pair.cloud.offered) == 2
    assert pair.result_of(wants) == []


def test_a_preparation_that_is_called_off_cancels_its_copies_at_once() -> None:
    """Rule 2."""
    pair = Pair()
    pair.goal(1)
    pair.prepare(Site.CLOUD, 2)
    pair.candidate = None
    pair.run(0.02)
    assert pair.cloud.cancelled == pair.cloud.offered
    assert pair.robot.cancelled == []


def test_a_preempted_copy_is_never_offered_again_and_its_end_counts_on_the_holder() -> None:
    """Rules 2 and 3: servers with one goal at a time."""
    pair = Pair()
    first = pair.goal(1)
    second = pair.goal(2)
    pair.prepare(Site.CLOUD, 2)
    pair.cloud.end(0, ABORTED)
    pair.run(1.2)
    assert len(pair.cloud.offered) == 2
    assert not pair.robot.statuses[-1].pending
    pair.robot.end(0, ABORTED)
    assert pair.result_of(first) == [ABORTED]
    assert pair.result_of(second) == []


def test_after_a_loss_the_robot_gets_the_goal_and_the_clouds_ends_do_not_count() -> None:
    """Rule 3."""
    pair = Pair()
    pair.in_cloud()
    pair.run(1.0)  # the cloud's relay is no new one any more
    wants = pair.goal(1)
    assert len(pair.cloud.offered) == 1
    assert not pair.robot.offered
    pair.lose = {Site.ROBOT, Site.CLOUD}
    pair.change(Site.ROBOT, 3, sudden=True)
    assert len(pair.robot.offered) == 1
    pair.run(1.5)
    assert pair.cloud.cancelled[0] == pair.cloud.offered[0]
    pair.lose = set()
    pair.cloud.end(0, ABORTED)
    pair.run(0.5)
    assert pair.result_of(wants) == []
    pair.robot.end(0)
    assert pair.result_of(wants) == [SUCCEEDED]


def test_an_end_that_nobody_asked_for_right_after_a_change_is_offered_again() -> None:
    """Rule 3: servers that abort while they start."""
    pair = Pair()
    wants = pair.goal(1)
    pair.prepare(Site.CLOUD, 2)
    pair.change(Site.CLOUD, 2)
    pair.cloud.end(0, ABORTED)
    pair.run(0.7)
    assert pair.result_of(wants) == []
    assert len(pair.cloud.offered) == 2
    pair.run(2.0)
    pair.cloud.end(1, ABORTED)
    assert pair.result_of(wants) == [ABORTED]


def test_goals_that_may_not_be_executed_twice_end_at_the_change() -> None:
    """`onSwitch: Abort` and `Hold`."""
    pair = Pair()
    spin, wait = pair.goal(1, SPIN), pair.goal(2, WAIT)
    assert pair.robot.statuses[-1].hold == WAIT
    pair.prepare(Site.CLOUD, 2)
    assert not pair.cloud.offered
    pair.change(Site.CLOUD, 2)
    assert pair.result_of(spin) == pair.result_of(wait) == [ABORTED]
    assert sorted(pair.robot.cancelled) == sorted(pair.robot.offered)
    assert not pair.cloud.offered


def test_the_robots_nodes_are_kept_until_their_goals_have_ended_or_the_deadline() -> None:
    """Rule 3: the order after a change."""
    pair = Pair()
    pair.goal(1)
    pair.prepare(Site.CLOUD, 2)
    pair.change(Site.CLOUD, 2)
    assert pair.robot.statuses[-1].busy
    pair.run(1.0)
    assert pair.robot.statuses[-1].busy
    pair.run(1.2)
    assert not pair.robot.statuses[-1].busy


def test_a_success_of_the_side_that_held_before_counts_while_there_is_none() -> None:
    """Rule 6: finished under its lease, arrived after the change."""
    pair = Pair()
    pair.in_cloud()
    wants = pair.goal(1)
    pair.lose = {Site.ROBOT}
    pair.cloud.end(0, SUCCEEDED, b"was there")
    pair.prepare(Site.ROBOT, 3)
    pair.change(Site.ROBOT, 3)
    assert pair.result_of(wants) == []
    pair.lose = set()
    pair.run(0.3)
    assert pair.result_of(wants) == [SUCCEEDED]
    assert pair.robot.cancelled == pair.robot.offered


def test_a_success_without_a_lease_does_not_count() -> None:
    """Rule 6."""
    pair = Pair()
    pair.in_cloud()
    wants = pair.goal(1)
    pair.change(Site.ROBOT, 3, sudden=True)
    pair.cloud.end(0, SUCCEEDED)
    pair.run(0.3)
    assert pair.result_of(wants) == []


def test_a_cancel_is_answered_at_once_and_wins_over_a_change() -> None:
    """Rule 7: never offered again, the copy that is accepted later is cancelled too."""
    pair = Pair()
    wants = pair.goal(1)
    pair.cloud.auto = False
    pair.prepare(Site.CLOUD, 2)
    code, entries = pair.ask_cancel(1)
    assert (code, [entry.goal_id for entry in entries]) == (CancelCode.NONE, [goal_id(1)])
    assert pair.robot.cancelled == pair.robot.offered
    pair.change(Site.CLOUD, 2)
    assert pair.result_of(wants) == [CANCELED]
    relay = pair.cloud.relay
    assert relay is not None
    relay.offer_answered(Face.GROUP, FOLLOW, pair.cloud.offered[0], True)
    pair.settle()
    assert pair.cloud.cancelled == pair.cloud.offered
    pair.run(1.0)
    assert len(pair.cloud.offered) == len(pair.robot.offered) == 1


def test_a_cancel_means_one_goal_or_those_before_a_time_or_all() -> None:
    """Rule 7: action_msgs/srv/CancelGoal, goal by goal."""
    pair = Pair()
    for number in (1, 2, 3):
        pair.goal(number)
        pair.run(0.1)
    assert pair.ask_cancel(9)[0] is CancelCode.UNKNOWN_GOAL
    stamps = [entry.stamp_ns for entry in pair.robot.shown[FOLLOW]]
    assert [e.goal_id for e in pair.ask_cancel(0, stamp_ns=stamps[0])[1]] == [goal_id(1)]
    pair.robot.end(0, CANCELED)
    assert pair.ask_cancel(1)[0] is CancelCode.TERMINATED
    assert [e.goal_id for e in pair.ask_cancel(0)[1]] == [goal_id(2), goal_id(3)]
    pair.robot.end(1, CANCELED)
    assert pair.result_of(b"result 2") == [CANCELED]


def test_a_client_that_did_not_cancel_never_hears_canceled() -> None:
    """Invariant 6e: somebody cancels at the server itself."""
    pair = Pair()
    wants = pair.goal(1)
    pair.robot.end(0, CANCELED, b"x")
    assert pair.robot.results == [(wants, ABORTED, b"\0\1\0\0\x06x")]


def test_results_are_kept_for_clients_that_ask_late_and_forgotten_in_the_end() -> None:
    """Rule 8."""
    pair = Pair()
    pair.goal(1)
    pair.robot.end(0, SUCCEEDED, b"late")
    pair.relay.result_requested(Face.PUBLIC, FOLLOW, b"again", goal_id(1))
    assert pair.robot.results[-1] == (b"again", SUCCEEDED, b"\0\1\0\0\x04late")
    pair.now += 901.0
    pair.run(0.2)
    pair.relay.result_requested(Face.PUBLIC, FOLLOW, b"too late", goal_id(1))
    assert pair.robot.results[-1] == (b"too late", GoalStatus.UNKNOWN, b"")
    assert pair.robot.shown[FOLLOW] == ()


@pytest.mark.parametrize(("count", "size", "kept"), [(258, 4, 256), (20, (1 << 20) - 64, 16)])
def test_of_results_that_nobody_fetches_the_newest_are_kept_up_to_256_and_16_mebibytes(
    count: int, size: int, kept: int
) -> None:
    """Rule 8."""
    pair = Pair()
    for number in range(1, count + 1):
        pair.goal(number)
        pair.robot.end(-1, SUCCEEDED, bytes(size))
    pair.run(0.2)
    for number in (count - kept, count - kept + 1, count):
        pair.relay.result_requested(Face.PUBLIC, FOLLOW, bytes([number % 256]), goal_id(number))
    assert [status for _, status, _ in pair.robot.results[-3:]] == [GoalStatus.UNKNOWN, SUCCEEDED, SUCCEEDED]


def test_a_server_that_was_started_again_gets_the_goal_again() -> None:
    """Rule 10: it has forgotten the goal; `Abort` goals end."""
    pair = Pair()
    wants, spin = pair.goal(1), pair.goal(2, SPIN)
    pair.see(pair.robot, "2")
    pair.run(0.1)
    assert len(pair.robot.offered) == 3
    assert pair.result_of(spin) == [ABORTED]
    pair.robot.end(2)
    assert pair.result_of(wants) == [SUCCEEDED]


def test_a_server_that_says_status_0_has_forgotten_the_goal() -> None:
    """Rule 10."""
    pair = Pair()
    pair.goal(1)
    pair.robot.end(0, GoalStatus.UNKNOWN)
    pair.run(0.1)
    assert len(pair.robot.offered) == 2


def test_an_offer_without_an_answer_ends_the_goal_and_is_cancelled_when_it_is_known() -> None:
    """Rule 12."""
    pair = Pair()
    pair.robot.auto = False
    wants = pair.goal(1)
    pair.run(1.9)
    assert pair.result_of(wants) == []
    pair.run(0.2)
    assert pair.result_of(wants) == [ABORTED]
    pair.relay.offer_answered(Face.GROUP, FOLLOW, pair.robot.offered[0], True)
    assert pair.robot.cancelled == pair.robot.offered
    pair.run(0.6)
    assert len(pair.robot.cancelled) == 2


def test_timeout_counts_from_when_the_holder_is_able() -> None:
    """Section 4: at most `prepareDeadline` after the need began."""
    pair = Pair()
    pair.able = ()
    pair.run(0.05)
    waits = pair.goal(1)
    pair.run(4.0)
    assert not pair.robot.offered
    assert pair.result_of(waits) == []
    pair.able = (Site.ROBOT,)
    pair.run(0.1)
    assert len(pair.robot.offered) == 1
    pair.able = ()
    pair.run(0.05)
    never = pair.goal(2)
    pair.run(7.2)
    assert pair.result_of(never) == [ABORTED]


def test_no_id_is_ever_given_to_a_server_twice() -> None:
    """Each attempt has an id of its own, over changes to and fro (the side asserts it for each offer)."""
    pair = Pair()
    pair.goal(1)
    for epoch in range(2, 12, 2):
        pair.prepare(Site.CLOUD, epoch)
        pair.change(Site.CLOUD, epoch)
        pair.prepare(Site.ROBOT, epoch + 1)
        pair.change(Site.ROBOT, epoch + 1)
    assert len(pair.robot.offered) == 6
    assert len(pair.cloud.offered) == 5
    pair.relay.goal_requested(Face.PUBLIC, FOLLOW, b"same id", goal(1))
    assert pair.robot.accepted[-1] == (b"same id", False)


def test_an_offer_under_a_token_that_ended_is_not_admitted_and_asked_again_under_the_new_one() -> None:
    """Section 3: `NotHolder` proves that no server saw it."""
    pair = Pair()
    pair.prepare(Site.CLOUD, 2)
    pair.change(Site.CLOUD, 2)
    pair.granted = None
    pair.run(0.3)
    wants = pair.goal(1)
    assert not pair.cloud.offered
    pair.granted = pair.holding.token
    pair.run(0.1)
    assert len(pair.cloud.offered) == 1
    pair.cloud.end(0)
    assert pair.result_of(wants) == [SUCCEEDED]


def test_a_goal_that_the_acting_side_does_not_accept_is_said() -> None:
    """A pin changes over when its patience ends: the stay goes on Degraded until the goal has found its server."""
    pair = Pair()
    pair.goal(1)
    pair.cloud.auto = False
    pair.prepare(Site.CLOUD, 2)
    pair.change(Site.CLOUD, 2)
    assert not pair.robot.statuses[-1].lacking
    pair.run(0.6)
    ((reason, message),) = pair.robot.statuses[-1].lacking
    assert (reason, FOLLOW in message) == (GOALS_PENDING, True)
    assert pair.cloud.relay is not None
    for attempt in pair.cloud.offered:
        pair.cloud.relay.offer_answered(Face.GROUP, FOLLOW, attempt, True)
    pair.run(0.1)
    assert not pair.robot.statuses[-1].lacking
