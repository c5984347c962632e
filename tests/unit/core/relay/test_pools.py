"""Call at a node with several pods: who gets the next one, and what becomes of the calls of a pod that goes."""

from __future__ import annotations

from collections import Counter

import pytest

from robot_offload_core.relay.cloud import CloudRelay
from robot_offload_core.relay.pools import SILENT_S, Pools
from robot_offload_core.relay.process import RelayPlan
from robot_offload_core.words.declared import ServiceMode, ServiceSpec, SettingsError
from tests.unit.core.relay.goals.pair import Pair
from tests.unit.core.relay.goals.test_requests import answer

DETECT, ASK, SEGMENT = "/detect", "/ask", "/segment"
KIND = "std_srvs/srv/Trigger"
PLAN = RelayPlan(
    services=(
        ServiceSpec(DETECT, KIND, "planner", of_cloud=True, pooled=True),
        ServiceSpec(ASK, KIND, "planner", ServiceMode.IDEMPOTENT, of_cloud=True, pooled=True),
        ServiceSpec(SEGMENT, KIND, "planner", of_cloud=True, pooled=True),
    )
)


def pools_of(pair: Pair) -> Pools:
    """Return the pools of the cloud's relay."""
    assert isinstance(pair.cloud.relay, CloudRelay)
    return pair.cloud.relay.pools


def see(pair: Pair, *members: str, again: str = "") -> None:
    """These pods serve everything; `again` was started anew."""
    for spec in PLAN.services:
        pools_of(pair).seen(spec.name, {it: f"{it} 2" if it == again else f"{it} 1" for it in members})
    pair.run(0.3)


@pytest.fixture
def pair() -> Pair:
    made = Pair(PLAN)
    see(made, "a", "b", "c")
    return made


def test_calls_go_to_the_pod_with_the_fewest_open_ones_in_turn(pair: Pair) -> None:
    for number in range(6):
        pair.call(DETECT, number)
    assert pair.cloud.members == ["a", "b", "c", "a", "b", "c"]
    answer(pair.cloud, 1)
    pair.call(DETECT, 6)
    assert pair.cloud.members[6:] == ["b"]


def test_a_pod_that_is_busy_with_another_service_of_its_node_gets_fewer_calls(pair: Pair) -> None:
    pair.call(SEGMENT, 1)
    pair.call(DETECT, 2)
    pair.call(DETECT, 3)
    pair.call(DETECT, 4)
    assert pair.cloud.members == ["a", "b", "c", "a"]


def test_calls_one_after_the_other_go_round(pair: Pair) -> None:
    for number in range(4):
        pair.call(DETECT, number)
        answer(pair.cloud)
    assert pair.cloud.members == ["a", "b", "c", "a"]
    assert len(pair.robot.answers) == 4


def test_a_pod_that_was_told_to_end_gets_no_new_calls_and_its_own_are_answered(pair: Pair) -> None:
    caller = pair.call(DETECT, 1)
    assert pools_of(pair).leave({"a", "gone"}) == ("gone",)
    for number in range(2, 6):
        pair.call(DETECT, number)
    assert pair.cloud.members == ["a", "b", "c", "b", "c"]
    answer(pair.cloud, 0)
    assert pair.robot.answers == [(caller, b"done")]
    assert pools_of(pair).leave({"a"}) == ("a",)


def test_calls_of_the_last_pod_are_answered_though_it_was_told_to_end(pair: Pair) -> None:
    see(pair, "a")
    caller = pair.call(DETECT, 1)
    pools_of(pair).leave({"a"})
    pair.run(0.5)
    assert not pair.robot.failures
    answer(pair.cloud)
    assert pair.robot.answers == [(caller, b"done")]


def test_a_call_waits_for_the_next_pod_while_all_others_leave(pair: Pair) -> None:
    see(pair, "a")
    pools_of(pair).leave({"a"})
    caller = pair.call(DETECT, 2)
    pair.run(0.2)
    assert not pair.cloud.calls
    see(pair, "a", "b")
    answer(pair.cloud)
    assert pair.robot.answers == [(caller, b"done")]


def test_a_call_that_may_be_repeated_is_begun_anew_when_its_pod_dies(pair: Pair) -> None:
    caller = pair.call(ASK, 1)
    see(pair, "b", "c")
    assert pair.cloud.members == ["a", "b"]
    answer(pair.cloud)
    assert pair.robot.answers == [(caller, b"done")]


def test_a_call_that_may_be_repeated_is_begun_anew_when_its_pod_was_replaced(pair: Pair) -> None:
    pair.call(ASK, 1)
    see(pair, "a", "b", "c", again="a")
    assert pair.cloud.members == ["a", "b"]


def test_a_call_that_must_not_be_repeated_fails_when_its_pod_dies(pair: Pair) -> None:
    caller = pair.call(DETECT, 1)
    see(pair, "b", "c")
    pair.run(3.0)
    assert pair.cloud.members == ["a"]
    assert pair.robot.failures == [(caller, "Unknown")]


def test_without_a_pod_a_call_is_refused_at_once(pair: Pair) -> None:
    see(pair)
    caller = pair.call(DETECT, 1)
    pair.run(0.1)
    assert pair.robot.failures == [(caller, "CloudAway")]


def test_a_silent_pod_is_asked_last_and_gets_another_chance(pair: Pair) -> None:
    see(pair, "a", "b")
    pair.call(DETECT, 1)
    pair.run(2.5)
    for number in range(2, 5):
        pair.call(DETECT, number)
        answer(pair.cloud)
    assert pair.cloud.members == ["a", "b", "b", "b"]
    pair.run(SILENT_S)
    pair.call(DETECT, 5)
    assert pair.cloud.members[4:] == ["a"]


def test_a_late_answer_counts_for_the_pod_that_gave_it(pair: Pair) -> None:
    pair.call(DETECT, 1)
    pair.run(2.5)
    answer(pair.cloud, 0)
    pair.call(DETECT, 2)
    assert pair.cloud.members == ["a", "b"]
    assert not pools_of(pair).calls.keys() & {1}


def test_what_is_known_of_pods_that_went_is_forgotten(pair: Pair) -> None:
    for number in range(50):
        see(pair, f"pod{number}")
        pair.call(DETECT, number)
        answer(pair.cloud)
    pools = pools_of(pair)
    assert (len(pools.turns), len(pools.silent), len(pools.calls)) == (1, 0, 0)


def test_a_new_relay_of_the_robot_begins_with_pods_that_are_free(pair: Pair) -> None:
    pair.call(DETECT, 1)
    pair.start_robot(journal=False)
    pair.run(0.5)
    assert not pools_of(pair).calls


def test_only_a_node_of_the_cloud_alone_is_pooled() -> None:
    with pytest.raises(SettingsError, match="pooled"):
        ServiceSpec(DETECT, KIND, "planner", pooled=True).check()


def test_a_service_without_a_pool_is_none_of_its() -> None:
    plain = Pools((ServiceSpec(DETECT, KIND, "planner", of_cloud=True),), Pair(PLAN).cloud, Counter())
    assert not plain.services
