"""Service calls over changes of the holder: who executes, what the caller gets (handover, section 3)."""

from __future__ import annotations

import pytest

from robot_offload_core.fence.token import Site
from robot_offload_core.relay.goals.ports import Face
from robot_offload_core.relay.process import MAX_PAYLOAD, RelayPlan
from robot_offload_core.relay.robot import DIVERGED
from robot_offload_core.words.declared import ServiceMode, ServiceSpec
from robot_offload_core.words.messages import Letters
from tests.unit.core.relay.goals.pair import ALL, CLEAR, COUNT, FOLLOW, LAMP, PLAN, Pair, Side


def answer(side: Side, index: int = -1, words: bytes = b"done", *, success: bool = True) -> None:
    _, _, key, _ = side.calls[index]
    assert side.relay is not None
    side.relay.call_answered(key, words, success)
    side.pair.settle()


@pytest.mark.parametrize("service", [PLAN, COUNT, CLEAR])
@pytest.mark.parametrize("site", list(Site))
def test_the_holder_executes_and_the_caller_hears_it_once(service: str, site: Site) -> None:
    pair = Pair()
    if site is Site.CLOUD:
        pair.in_cloud()
    caller = pair.call(service, 1)
    side, other = (pair.robot, pair.cloud) if site is Site.ROBOT else (pair.cloud, pair.robot)
    assert len(side.calls) == 1
    assert not other.calls
    answer(side)
    answer(side)
    assert pair.robot.answers == [(caller, b"done")]
    pair.run(3.0)
    assert not pair.robot.failures


def test_a_commanded_change_leaves_requests_where_they_are() -> None:
    pair = Pair()
    caller = pair.call(PLAN, 1)
    pair.prepare(Site.CLOUD, 2)
    pair.change(Site.CLOUD, 2)
    pair.run(0.5)
    assert pair.robot.statuses[-1].busy
    assert not pair.cloud.calls
    answer(pair.robot)
    assert pair.robot.answers == [(caller, b"done")]
    pair.run(0.1)
    assert not pair.robot.statuses[-1].busy


def test_after_a_loss_holder_fails_and_idempotent_asks_the_new_holder() -> None:
    """Nobody knows whether the cloud has executed them."""
    pair = Pair()
    pair.in_cloud()
    once, again = pair.call(PLAN, 1), pair.call(COUNT, 2)
    pair.lose = {Site.ROBOT, Site.CLOUD}
    pair.change(Site.ROBOT, 3, sudden=True)
    pair.run(0.6)
    assert pair.robot.failures == [(once, "Unknown")]
    assert [name for _, name, _, _ in pair.robot.calls] == [COUNT]
    answer(pair.robot)
    assert pair.robot.answers == [(again, b"done")]


def test_a_late_answer_counts_while_the_caller_has_none() -> None:
    pair = Pair()
    pair.in_cloud()
    caller = pair.call(COUNT, 1)
    pair.lose = {Site.ROBOT, Site.CLOUD}
    pair.change(Site.ROBOT, 3, sudden=True)
    pair.run(0.6)
    pair.lose = set()
    answer(pair.cloud, words=b"late")
    pair.run(0.2)
    answer(pair.robot, words=b"later")
    assert pair.robot.answers == [(caller, b"late")]


def test_a_cloud_relay_that_was_started_again_between_execution_and_answer_executes_nothing_twice() -> None:
    """`Holder` fails, a query is not repeated on the same stay either unless its holder changed."""
    pair = Pair()
    pair.in_cloud()
    caller = pair.call(PLAN, 1)
    pair.start_cloud()
    pair.run(0.5)
    assert pair.robot.failures == [(caller, "Unknown")]
    assert len(pair.cloud.calls) == 1


def test_not_holder_is_asked_again_and_waits_no_longer_than_timeout() -> None:
    pair = Pair()
    pair.in_cloud()
    pair.granted = None
    pair.run(0.05)
    waits = pair.call(PLAN, 1)
    pair.run(0.3)
    assert not pair.cloud.calls
    pair.granted = pair.holding.token
    pair.run(0.1)
    answer(pair.cloud)
    assert pair.robot.answers == [(waits, b"done")]
    pair.granted = None
    pair.run(0.05)
    never = pair.call(PLAN, 2)
    pair.run(2.1)
    assert pair.robot.failures == [(never, "Timeout")]
    assert len(pair.cloud.calls) == 1


def test_a_number_that_was_refused_is_never_admitted_later() -> None:
    """A copy of the request that was under way arrives after `NotHolder`, and the token is right by then."""
    pair = Pair()
    pair.in_cloud()
    pair.granted = None
    pair.run(0.05)
    pair.call(PLAN, 1)
    relay = pair.cloud.relay
    assert relay is not None
    copies = []
    pair.settle()
    for frame in [letter.frame for letter in pair.relay.post.courier.letters.values()]:
        copies.append(frame)
    pair.granted = pair.holding.token
    pair.run(0.3)
    before = len(pair.cloud.calls)
    assert before == 1

    for frame in copies:
        relay.handle(Letters(frame))
    pair.settle()
    assert len(pair.cloud.calls) == before


def test_while_no_holder_is_able_64_requests_of_a_service_wait() -> None:
    pair = Pair()
    pair.able = ()
    pair.run(0.05)
    for number in range(65):
        pair.call(PLAN, number)
    assert pair.robot.failures == [(b"call 64", "TooManyWaiting")]
    pair.able = (Site.ROBOT,)
    pair.run(0.1)
    assert len(pair.robot.calls) == 64


def test_both_is_played_on_the_candidate_before_it_is_ready() -> None:
    pair = Pair()
    pair.call(CLEAR, 1, b"old")
    answer(pair.robot)
    pair.call(CLEAR, 2, b"new")
    answer(pair.robot)
    assert not pair.cloud.calls
    pair.prepare(Site.CLOUD, 2)
    assert [words for *_, words in pair.cloud.calls] == [b"new"]
    assert pair.robot.statuses[-1].pending[0][0] == DIVERGED
    answer(pair.cloud)
    assert not pair.robot.statuses[-1].pending
    assert len(pair.robot.answers) == 2
    pair.change(Site.CLOUD, 2)
    pair.run(1.0)
    assert len(pair.cloud.calls) == 1


def test_both_that_says_success_false_on_the_candidate_leaves_it_unready() -> None:
    pair = Pair()
    pair.call(CLEAR, 1)
    answer(pair.robot)
    pair.prepare(Site.CLOUD, 2)
    answer(pair.cloud, success=False)
    pair.run(0.5)
    assert pair.robot.statuses[-1].pending[0][0] == DIVERGED
    assert len(pair.cloud.calls) == 1


def test_both_is_played_at_once_after_a_loss() -> None:
    pair = Pair()
    pair.in_cloud()
    pair.call(CLEAR, 1)
    answer(pair.cloud)
    pair.change(Site.ROBOT, 3, sudden=True)
    assert [name for _, name, _, _ in pair.robot.calls] == [CLEAR]


@pytest.mark.parametrize("first", list(Site))
def test_in_a_race_the_first_answer_wins(first: Site) -> None:
    spec = ServiceSpec("/guess", "std_srvs/srv/Trigger", "controller", ServiceMode.RACE, hot=(Site.CLOUD,))
    pair = Pair(RelayPlan(services=(spec,)))
    caller = pair.call("/guess", 1)
    assert len(pair.robot.calls) == len(pair.cloud.calls) == 1
    sides = {Site.ROBOT: pair.robot, Site.CLOUD: pair.cloud}
    answer(sides[first], words=b"first")
    answer(sides[first.other], words=b"second")
    assert pair.robot.answers == [(caller, b"first")]


def used(side: Side, number: int) -> bytes:
    caller = b"used %d" % number
    assert side.relay is not None
    side.relay.called(Face.GROUP, LAMP, caller, b"on")
    side.pair.settle()
    return caller


def test_used_services_are_called_by_the_holder_only() -> None:
    """Invariant 7a: a standby's call is refused at once, a preparing side's waits until that is decided."""
    pair = Pair()
    here = used(pair.robot, 1)
    there = used(pair.cloud, 2)
    assert [face for face, *_ in pair.robot.calls] == [Face.PUBLIC]
    assert pair.cloud.failures == [(there, "Standby")]
    answer(pair.robot)
    assert pair.robot.answers == [(here, b"done")]
    pair.prepare(Site.CLOUD, 2)
    waits = used(pair.cloud, 3)
    pair.run(0.2)
    assert len(pair.robot.calls) == 1
    pair.change(Site.CLOUD, 2)
    assert len(pair.robot.calls) == 2
    answer(pair.robot)
    assert pair.cloud.answers == [(waits, b"done")]
    refused = used(pair.robot, 4)
    assert pair.robot.failures == [(refused, "Standby")]


def test_a_waiting_used_call_is_refused_when_the_preparation_is_called_off() -> None:
    pair = Pair()
    pair.prepare(Site.CLOUD, 2)
    waits = used(pair.cloud, 1)
    pair.candidate = None
    pair.run(0.1)
    assert pair.cloud.failures == [(waits, "Standby")]
    assert not pair.robot.calls


def test_after_a_loss_used_calls_wait_until_the_lease_has_ended() -> None:
    """The robot's effects begin only when control says so."""
    pair = Pair()
    pair.in_cloud()
    pair.change(Site.ROBOT, 3, sudden=True)
    pair.effects = None
    pair.run(0.05)
    caller = used(pair.robot, 1)
    pair.run(0.3)
    assert not pair.robot.calls
    pair.effects = Site.ROBOT
    pair.run(0.05)
    answer(pair.robot)
    assert pair.robot.answers == [(caller, b"done")]


def test_a_request_larger_than_a_mebibyte_fails_and_says_so() -> None:
    pair = Pair()
    caller = pair.call(PLAN, 1, bytes(MAX_PAYLOAD + 1))
    assert pair.robot.failures == [(caller, "TooLarge")]
    assert ALL.services[0].name == PLAN


def test_a_call_of_both_that_the_acting_side_refuses_is_said() -> None:
    pair = Pair()
    pair.call(CLEAR, 1)
    answer(pair.robot)
    pair.in_cloud()
    answer(pair.cloud, success=False)
    pair.run(0.2)
    ((reason, message),) = pair.robot.statuses[-1].lacking
    assert (reason, CLEAR in message) == (DIVERGED, True)


def test_diagnostics_show_how_many_goals_and_calls_are_open() -> None:
    pair = Pair()
    pair.robot.auto = False
    pair.goal(1)
    pair.call(PLAN, 2)
    used(pair.robot, 3)
    pair.run(0.1)
    shown = dict(pair.robot.statuses[-1].counters)
    assert {name.partition(".")[2]: n for name, n in shown.items() if name.startswith("open.")} == {
        "goals_running": 0, "goals_waiting": 1, "calls": 1, "used_goals": 0, "used_calls": 1,
    }  # fmt: skip
    assert [shown[f"{name}.{word}"] for name, word in ((FOLLOW, "running"), (FOLLOW, "waiting"), (PLAN, "open"))] == [
        0, 1, 1,
    ]  # fmt: skip
    pair.run(3.0)
    assert all(n == 0 for name, n in pair.robot.statuses[-1].counters if name.startswith("open."))
