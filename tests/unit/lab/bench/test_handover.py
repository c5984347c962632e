"""What a client felt of a handover is worked out from what the observers wrote down."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import pytest

from robot_offload_lab.bench.analysis import handover
from robot_offload_lab.bench.analysis.handover import HandoverAccount, Moment, Phase
from robot_offload_lab.bench.groups.handover import CASE, MIRRORED
from robot_offload_lab.bench.observed import CallAnswered, GoalAnswered, GoalEnded, GoalFeedback, Observation
from robot_offload_lab.bench.results import Figure

numbers = itertools.count(1)


def goal(at_s: float, answer_ms: float, feedback_s: tuple[float, ...] = (), ends: tuple[int, ...] = (4,)) -> Iterator[
    Observation
]:  # fmt: skip
    number = next(numbers)
    yield GoalAnswered(at_s + answer_ms / 1e3, at_s, number, "/bench", 10, True)
    yield from (GoalFeedback(t_s, number, 7, tick) for tick, t_s in enumerate(feedback_s, start=1))
    end_s = feedback_s[-1] + 0.02 if feedback_s else at_s + 5.0
    yield from (GoalEnded(end_s, number, "/bench", status, 7) for status in ends)


def account(*observations: Observation, kind: str = "commanded") -> HandoverAccount:
    phases = (Phase("direct", "/direct", 0, 10), Phase("robot", "/bench", 20, 30), Phase("cloud", "/bench", 40, 50))
    return HandoverAccount(phases, (Moment(kind, 100, 101, 110),), observations, 90.0, 10.0)


def figures(given: HandoverAccount) -> dict[str, Figure]:
    return {figure.name: figure for figure in handover.outcome(handover.GROUP, CASE, "realtime", given).figures}


def test_acceptance_stands_beside_the_direct_path() -> None:
    found = figures(account(*goal(1.0, 2.0), *goal(21.0, 5.0), *goal(41.0, 25.0)))
    assert found["accepted_robot"].value == pytest.approx(5.0)
    assert found["accepted_robot"].baseline == pytest.approx(2.0)
    assert found["accepted_robot"].met(8) is True
    assert found["accepted_cloud"].met(found["accepted_cloud"].must) is False


def test_a_call_is_charged_with_what_it_takes_beyond_a_direct_one() -> None:
    calls = [CallAnswered(1.002, 1.0, "/direct", True), CallAnswered(21.005, 21.0, "/bench", True)]
    found = figures(account(*calls))
    assert found["call_robot_p50"].value == pytest.approx(3.0)
    assert found["call_cloud_p50"].value is None
    assert found["call_cloud_p50"].must == 14.0


def test_the_longest_silence_of_each_goal_counts() -> None:
    found = figures(account(*goal(100.5, 2.0, (100.6, 100.62, 100.70, 100.72)), *goal(100.5, 2.0, (100.6, 100.65))))
    assert found["gap_commanded"].count == 2
    assert found["gap_commanded"].value == pytest.approx(80.0, abs=1.0)
    assert found["gap_cut"].count == 0


@pytest.mark.parametrize(("ends", "what"), [((), "1 lost"), ((4, 4), "1 doubled"), ((6,), "1 wrong")])
def test_a_goal_without_exactly_one_good_result_is_a_fault(ends: tuple[int, ...], what: str) -> None:
    found = figures(account(*goal(100.5, 2.0, (100.6, 100.62), ends), *goal(100.5, 2.0, (100.6, 100.62))))
    assert found["faults"].value == 1
    assert what in found["faults"].note
    assert "of 2 goals" in found["faults"].note


def test_a_mirrored_goal_may_miss_a_period_of_the_output_and_what_it_takes_to_be_sure() -> None:
    given = account(*goal(100.5, 2.0, (100.6, 100.62, 100.70, 100.72)), kind="cut")
    found = {figure.name: figure for figure in handover.mirrored(MIRRORED, "realtime", given).figures}
    assert (found["gap_cut"].must, found["gap_cut"].aim) == (110.0, 80.0)
    assert found["gap_cut"].value == pytest.approx(80.0, abs=1.0)
    assert found["faults"].note == "0 lost, 0 doubled, 0 wrong of 1 goals through a sudden cut"
