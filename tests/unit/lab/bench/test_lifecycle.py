import pytest

from robot_offload_lab.bench.analysis import lifecycle
from robot_offload_lab.bench.analysis.lifecycle import BASELINE, Rounds, TransitionCase

ALONE = TransitionCase(BASELINE, "one node alone", "1-12 ms")
TEN = TransitionCase("together", "ten at once")


def rounds(case: TransitionCase, activate: list[list[float]], deactivate: list[list[float]], **lost: int) -> Rounds:
    said = {"activate": activate, "deactivate": deactivate, "refused": 0, "unanswered": 0}
    return Rounds.from_json(case, said | lost)


def figures(*found: Rounds, refused: dict[str, str] | None = None):
    return {figure.name: figure for figure in lifecycle.outcome("realtime", found, refused or {}).figures}


def test_several_nodes_asked_at_once_are_ready_with_the_last_answer():
    found = rounds(TEN, [[1.0, 4.0, 2.0], [3.0, 1.0, 2.0]], [[1.0, 1.0, 5.0]])
    assert found.whole("activate") == (4.0, 3.0)
    assert found.each("deactivate") == (1.0, 1.0, 5.0)
    assert found.several


def test_every_case_is_compared_with_a_node_alone_in_the_same_run():
    found = figures(rounds(ALONE, [[2.0]], [[1.0]]), rounds(TEN, [[3.0, 6.0]], [[1.0, 4.0]]))
    assert found["alone_activate_p50"].ratio is None
    assert found["together_activate_p50"].ratio == pytest.approx(3.0)
    assert found["together_deactivate_p50"].ratio == pytest.approx(4.0)
    assert "until the last has answered" in found["together_activate_p50"].note


def test_the_figures_of_the_thesis_stand_beside():
    assert "thesis: 1-12 ms" in figures(rounds(ALONE, [[2.0]], [[1.0]]))["alone_activate_p50"].note


def test_a_refused_transition_is_counted_against_a_limit_of_none():
    refused = figures(rounds(ALONE, [[2.0]], [[1.0]], refused=1))["refused"]
    assert (refused.value, refused.count) == (1, 2)
    assert refused.met(refused.must) is False


def test_a_transition_without_an_answer_is_counted_beside():
    unanswered = figures(rounds(ALONE, [[]], [[1.0]], unanswered=1))["unanswered"]
    assert (unanswered.value, unanswered.count) == (1, 2)
    assert "agents ask again" in unanswered.note


def test_a_case_that_this_machine_cannot_run_says_why():
    found = figures(rounds(ALONE, [[2.0]], [[1.0]]), refused={"two hosts": "network namespaces need root"})
    missing = found["missing_two hosts"]
    assert missing.value is None
    assert missing.note == "not run: network namespaces need root"


def test_the_samples_tell_case_and_transition():
    samples = lifecycle.outcome("realtime", [rounds(ALONE, [[2.0]], [[1.0]])], {}).samples
    assert [(s["series"], s["ms"]) for s in samples] == [
        ("one node alone, activation", 2.0), ("one node alone, deactivation", 1.0)
    ]  # fmt: skip
