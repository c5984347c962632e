"""Feedback passes a relay without a turn; whatever else comes in makes a turn due at once."""

from __future__ import annotations

from typing import Any

import pytest

from robot_offload_core.fence.token import Site
from robot_offload_core.relay.goals.ports import CancelCode, Face, GoalStatus
from robot_offload_core.relay.goals.wire_ids import with_goal_id
from robot_offload_core.relay.process import RelayProcess
from robot_offload_core.relay.robot import HOLDER_LOOK_S
from robot_offload_core.words.holding import Holding
from robot_offload_core.words.messages import Letters
from tests.unit.core.relay.goals.pair import COUNT, FOLLOW, LAMP, LIFT, Pair, Side, goal, goal_id, token

AT_ONCE = float("-inf")
ATTEMPT = b"x" * 16
BOTH: list[tuple[str, tuple[Any, ...]]] = [
    ("servers_seen", ([],)),
    ("offer_answered", (Face.GROUP, FOLLOW, ATTEMPT, False)),
    ("cancel_answered", (Face.GROUP, FOLLOW, ATTEMPT, CancelCode.NONE)),
    ("result_arrived", (Face.GROUP, FOLLOW, ATTEMPT, GoalStatus.UNKNOWN, b"")),
    ("call_answered", (99, b"")),
    ("goal_requested", (Face.GROUP, LIFT, b"caller", goal(7))),
    ("cancel_requested", (Face.GROUP, LIFT, b"caller", goal_id(7), 0)),
    ("result_requested", (Face.GROUP, LIFT, b"caller", goal_id(7))),
    ("called", (Face.GROUP, LAMP, b"caller", b"please")),
    ("handle", (Letters(b"garbage"),)),
]
ROBOT_ALONE: list[tuple[str, tuple[Any, ...]]] = [
    ("goal_requested", (Face.PUBLIC, FOLLOW, b"caller", goal(7))),
    ("cancel_requested", (Face.PUBLIC, FOLLOW, b"caller", goal_id(7), 0)),
    ("result_requested", (Face.PUBLIC, FOLLOW, b"caller", goal_id(7))),
    ("called", (Face.PUBLIC, COUNT, b"caller", b"please")),
]


def rested(side: Side) -> RelayProcess:
    """A relay that has nothing to do before time passes."""
    assert side.relay is not None
    assert side.relay.due_s > side.pair.now
    return side.relay


@pytest.mark.parametrize(("name", "given"), [*BOTH, *ROBOT_ALONE], ids=lambda it: it if isinstance(it, str) else "")
def test_what_reaches_the_robots_relay_makes_a_turn_due(name: str, given: tuple[Any, ...]) -> None:
    relay = rested(Pair().robot)
    getattr(relay, name)(*given)
    assert relay.due_s == AT_ONCE


@pytest.mark.parametrize(("name", "given"), BOTH, ids=lambda it: it if isinstance(it, str) else "")
def test_what_reaches_the_clouds_relay_makes_a_turn_due(name: str, given: tuple[Any, ...]) -> None:
    relay = rested(Pair().cloud)
    getattr(relay, name)(*given)
    assert relay.due_s == AT_ONCE


def test_the_level_of_control_makes_a_turn_due_on_both_sides() -> None:
    pair = Pair()
    relays = [rested(pair.robot), rested(pair.cloud)]
    pair.say()
    assert [relay.due_s for relay in relays] == [AT_ONCE, AT_ONCE]


def test_feedback_of_the_robots_replica_reaches_the_client_and_makes_nothing_due() -> None:
    pair = Pair()
    pair.goal(1)
    relay = rested(pair.robot)
    due_s = relay.due_s
    relay.feedback_arrived(Face.GROUP, FOLLOW, with_goal_id(bytes(20), pair.robot.offered[0]) + b"on my way")
    assert [words[20:] for words in pair.robot.feedback] == [b"on my way"]
    assert relay.due_s == due_s


def test_feedback_of_the_clouds_replica_crosses_and_makes_nothing_due_on_either_side() -> None:
    pair = Pair()
    pair.goal(1)
    pair.in_cloud()
    relays = [rested(pair.cloud), rested(pair.robot)]
    due_s = [relay.due_s for relay in relays]
    relays[0].feedback_arrived(Face.GROUP, FOLLOW, with_goal_id(bytes(20), pair.cloud.offered[-1]) + b"on my way")
    [(to, letters)] = pair.wire
    assert to is Site.ROBOT
    relays[1].handle(letters)
    assert [words[20:] for words in pair.robot.feedback] == [b"on my way"]
    assert [relay.due_s for relay in relays] == due_s


def test_while_only_feedback_comes_a_change_of_the_holder_is_seen_at_the_next_look() -> None:
    pair = Pair()
    pair.goal(1)
    relay = rested(pair.robot)
    pair.holding = Holding(Site.CLOUD, pair.holding.stay + 1, token(2))
    words = with_goal_id(bytes(20), pair.robot.offered[0])
    until_s = pair.now + HOLDER_LOOK_S
    while pair.now < until_s:
        pair.now += 0.005
        relay.feedback_arrived(Face.GROUP, FOLLOW, words)
        relay.turn()
    assert pair.relay.ledger.holding == pair.holding
