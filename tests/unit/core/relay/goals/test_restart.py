"""Either relay dies: the journal, what its successor does, and words of a relay that is gone."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from robot_offload_core.fence.token import Site
from robot_offload_core.relay.goals import journal
from robot_offload_core.relay.goals.ports import ALL_GOALS, CancelCode, Face, GoalStatus
from robot_offload_core.words.holding import Holding
from robot_offload_core.words.messages import Letters
from tests.unit.core.relay.goals.pair import FOLLOW, PLAN, SPIN, Pair, goal, goal_id, token
from tests.unit.core.relay.goals.test_mirrors import PLAN as MIRRORED


def test_a_successor_goes_on_with_the_goals_and_answers_the_clients_of_its_predecessor() -> None:
    """Section 7: the result is asked for again, the open request is answered, once."""
    pair = Pair()
    wants = pair.goal(1)
    pair.start_robot()
    pair.run(0.3)
    assert pair.robot.results_asked == pair.robot.offered * 2
    assert len(pair.robot.offered) == 1
    pair.robot.end(0)
    assert pair.result_of(wants) == [GoalStatus.SUCCEEDED]


def test_a_successor_offers_again_what_the_server_has_forgotten() -> None:
    pair = Pair()
    pair.goal(1)
    pair.start_robot()
    pair.run(0.1)
    pair.robot.end(0, GoalStatus.UNKNOWN)
    assert len(pair.robot.offered) == 2


def test_a_successor_takes_up_goals_that_the_cloud_executes() -> None:
    pair = Pair()
    pair.in_cloud()
    wants = pair.goal(1)
    pair.start_robot()
    pair.run(0.5)
    assert len(pair.cloud.offered) == 1
    pair.cloud.feed(0)
    assert len(pair.robot.feedback) == 1
    pair.cloud.end(0)
    assert pair.result_of(wants) == [GoalStatus.SUCCEEDED]


def test_a_result_that_ended_while_nobody_listened_is_said_again() -> None:
    """Rule 10 and section 7: the letter was for the predecessor; the server is asked again and knows the result."""
    pair = Pair()
    pair.in_cloud()
    wants = pair.goal(1)
    pair.lose = {Site.ROBOT}
    pair.cloud.end(0)
    pair.start_robot()
    pair.lose = set()
    pair.run(0.6)
    assert pair.result_of(wants) == [GoalStatus.SUCCEEDED]


def test_a_new_cloud_relay_takes_up_what_its_server_executes() -> None:
    pair = Pair()
    pair.in_cloud()
    wants = pair.goal(1)
    pair.start_cloud()
    pair.run(0.5)
    assert pair.cloud.results_asked == pair.cloud.offered * 2
    pair.cloud.end(0)
    assert pair.result_of(wants) == [GoalStatus.SUCCEEDED]


def test_a_new_cloud_relay_that_nobody_names_goals_to_ends_those_of_its_predecessor() -> None:
    """Its predecessor's ids are unknown to it; meanwhile nothing is offered, because the cancel would end that too."""
    pair = Pair()
    pair.in_cloud()
    pair.goal(1)
    pair.lose |= {Site.CLOUD}
    pair.change(Site.ROBOT, 9, sudden=True)
    pair.start_cloud()
    pair.run(0.9)
    assert pair.cloud.cancelled == []
    pair.run(0.5)
    assert set(pair.cloud.cancelled) == {ALL_GOALS}
    pair.lose.clear()
    pair.prepare(Site.CLOUD, 10)
    assert len(pair.cloud.offered) == 1
    pair.cloud.relay.cancel_answered(Face.GROUP, FOLLOW, ALL_GOALS, CancelCode.NONE)
    pair.run(1.0)
    assert len(pair.cloud.offered) == 2


def test_a_new_cloud_relay_that_the_robot_speaks_to_ends_nothing() -> None:
    pair = Pair()
    pair.in_cloud()
    pair.goal(1)
    pair.start_cloud()
    pair.run(3.0)
    assert pair.cloud.cancelled == []


def taken_over() -> Pair:
    """The robot has taken over from a cloud with a goal, the link is cut, and the cloud's relay is new."""
    pair = Pair()
    pair.in_cloud()
    pair.goal(1, SPIN)
    pair.lose = set(Site)
    pair.change(Site.ROBOT, 9, sudden=True)
    pair.start_cloud()
    return pair


def test_a_new_cloud_relay_that_the_robot_does_not_know_ends_the_goals_of_its_predecessor() -> None:
    """It hears the robot, which hears nothing and so has nobody to name its attempts to (storm 9601, stretch 1161)."""
    pair = taken_over()
    pair.lose = {Site.ROBOT}
    pair.run(1.5)
    assert set(pair.cloud.cancelled) == {ALL_GOALS}


def test_a_new_cloud_relay_ends_the_goals_of_its_predecessor_when_the_link_is_cut_before_the_robot_has_named_them() -> (
    None
):
    """Both relays have met; the robot's letters are lost."""
    pair = taken_over()
    pair.lose_letters = {Site.CLOUD}
    pair.lose = set()
    pair.run(0.5)
    pair.lose = set(Site)
    pair.run(1.5)
    assert set(pair.cloud.cancelled) == {ALL_GOALS}


def test_a_new_cloud_relay_that_the_robot_leaves_ends_nothing_while_a_mirror_of_the_same_action_runs() -> None:
    """Ids of a predecessor are unknown: while a goal of an action may run, the others of it cannot be ended."""
    pair = Pair(MIRRORED)
    pair.goal(1)
    pair.start_cloud()
    pair.run(0.5)
    pair.lose = set(Site)
    pair.run(3.0)
    assert pair.cloud.cancelled == []
    pair.cloud.end(0)
    pair.run(0.1)
    assert set(pair.cloud.cancelled) == {ALL_GOALS}


def test_an_ended_result_is_kept_over_a_restart() -> None:
    """Rule 8."""
    pair = Pair()
    pair.goal(1)
    pair.robot.end(0, GoalStatus.SUCCEEDED, b"kept")
    pair.start_robot()
    pair.run(0.1)
    pair.relay.result_requested(Face.PUBLIC, FOLLOW, b"late", goal_id(1))
    assert pair.robot.results[-1] == (b"late", GoalStatus.SUCCEEDED, b"\0\1\0\0\x04kept")


def test_a_change_of_the_holder_while_no_relay_lived_is_noticed() -> None:
    """The stay stands in the journal and in the collector's memory."""
    pair = Pair()
    pair.goal(1)
    records = list(pair.robot.journal)
    pair.prepare(Site.CLOUD, 2)
    pair.robot.relay = None
    pair.robot.journal = records
    pair.holding = Holding(Site.CLOUD, pair.holding.stay + 1, token(2))
    pair.candidate = None
    pair.start_robot()
    pair.run(0.5)
    assert pair.relay.ledger.holding.site is Site.CLOUD
    assert pair.robot.cancelled == pair.robot.offered


def test_open_calls_of_a_predecessor_fail() -> None:
    pair = Pair()
    caller = pair.call(PLAN, 1)
    pair.start_robot()
    assert pair.robot.failures == [(caller, "RelayRestarted")]
    pair.start_robot()
    assert len(pair.robot.failures) == 1


def test_a_goal_without_room_in_the_journal_is_refused() -> None:
    """Section 7: `JournalFull`."""
    pair = Pair()
    pair.robot.room = False
    pair.relay.goal_requested(Face.PUBLIC, FOLLOW, b"full", goal(1))
    assert pair.robot.accepted == [(b"full", False)]
    assert not pair.robot.offered
    pair.robot.room = True
    pair.goal(2)
    assert pair.robot.accepted[-1][1] is True


def test_words_of_a_relay_that_was_replaced_count_for_nothing() -> None:
    pair = Pair()
    pair.in_cloud()
    kept: list[Letters] = []
    send = pair.cloud.send

    def tapped(to: str, message: object) -> bool:
        if isinstance(message, Letters):
            kept.append(message)
        return send(to, message)

    pair.cloud.send = tapped  # type: ignore[method-assign]
    wants = pair.goal(1)
    pair.run(0.2)
    pair.cloud.end(0)
    assert pair.result_of(wants) == [GoalStatus.SUCCEEDED]
    pair.start_cloud()
    pair.run(0.3)
    peer = pair.relay.post.courier.peer
    for letters in kept:
        pair.relay.handle(letters)
    assert pair.relay.post.courier.peer == peer
    assert pair.result_of(wants) == [GoalStatus.SUCCEEDED]


@given(st.lists(st.binary(min_size=1, max_size=60), max_size=6), st.integers(0, 400), st.binary(max_size=20))
def test_a_torn_end_of_a_journal_is_dropped(records: list[bytes], cut: int, rest: bytes) -> None:
    whole = b"".join(map(journal.frame, records))
    assert list(journal.unframe(whole)) == records
    read = list(journal.unframe(whole[:cut]))
    assert read == records[: len(read)]
    assert list(journal.unframe(whole + rest))[: len(records)] == records


@given(st.lists(st.binary(max_size=200), max_size=5))
def test_records_that_are_none_are_left_out(records: list[bytes]) -> None:
    pair = Pair()
    pair.goal(1)
    said = journal.replay([*records, *pair.robot.journal])
    assert list(said.goals) == [goal_id(1)]
    assert said.dropped == len(records)


def test_a_compacted_journal_says_the_same() -> None:
    pair = Pair()
    for number in range(4):
        pair.goal(number)
    pair.ask_cancel(2)
    pair.robot.end(1, GoalStatus.SUCCEEDED, b"x")
    pair.prepare(Site.CLOUD, 2)
    before = journal.restored(pair.relay.ledger, journal.replay(pair.robot.journal))
    after = journal.restored(
        pair.relay.ledger, journal.replay(journal.whole(pair.relay.ledger, {}))
    )  # fmt: skip
    assert after.goals == before.goals
    assert {g.id: (g.payload, g.result, g.status) for g in after.goals.values()} == {
        g.id: (g.payload, g.result, g.status) for g in pair.relay.ledger.goals.values()
    }
