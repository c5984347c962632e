"""Our rule costs less than every other rule on every recording at hand, also with figures found on other ones."""

from __future__ import annotations

from pathlib import Path

import pytest

from robot_offload.replay.named import CONSTANT, OURS, POLICIES
from robot_offload.replay.study import Case, outcome
from robot_offload.replay.tune import DEFAULT, GRID, Figures, Sights, leave_one_out, steps
from robot_offload.traces import load_trace
from tests.unit.replay.cases import EXAMPLES, RECORDED, ROOT, example, made_case

MADE_UP = ROOT / "examples" / "traces"
REAL = ROOT.parent / "shared" / "traces"
"""Recorded links are too large and not ours to copy; they are tried where they are kept beside the repository."""


def recordings() -> list[tuple[Path, float]]:
    found = [(MADE_UP / name, tolerance_s) for name, tolerance_s in EXAMPLES.items()]
    return found + [(REAL / name, tolerance_s) for name, tolerance_s in RECORDED.items() if (REAL / name).exists()]


@pytest.mark.parametrize(("file", "tolerance_s"), recordings(), ids=lambda value: getattr(value, "stem", ""))
def test_our_rule_costs_less_than_every_other_rule(file: Path, tolerance_s: float) -> None:
    subject = made_case(load_trace(file), tolerance_s)
    costs = {name: outcome(policy, subject).score.cost for name, policy in POLICIES.items() if name not in CONSTANT}
    ours = costs.pop(OURS.name)
    assert all(ours < cost for cost in costs.values()), (ours, costs)
    assert ours >= subject.best.score.cost
    assert subject.best.score.cost <= min(costs.values())


@pytest.fixture(scope="module")
def examples() -> list[Case]:
    return [example(name) for name in EXAMPLES]


def test_the_search_drives_the_same_rule_as_the_replay(examples: list[Case]) -> None:
    for subject in examples:
        assert Sights(subject).cost(DEFAULT) == pytest.approx(outcome(OURS, subject).score.cost)


def test_the_present_figures_are_among_those_that_are_searched() -> None:
    assert DEFAULT in GRID


def test_a_report_tells_of_a_recording_that_was_not_searched(examples: list[Case]) -> None:
    grid = (Figures(hold_down_initial_s=0.25), Figures(hold_down_initial_s=4.0), Figures(proof_max_s=1.0))
    told: list[int] = []
    reports = leave_one_out(examples, outcome, told.append, grid)
    assert [(report.trace, report.trained_on) for report in reports] == [
        ("corridor-wifi.txt", ("yard-4g.csv",)),
        ("yard-4g.csv", ("corridor-wifi.txt",)),
    ]
    for index, report in enumerate(reports):
        elsewhere = Sights(examples[1 - index])
        assert report.figures == min(grid, key=elsewhere.cost)
        assert report.tuned == pytest.approx(Sights(examples[index]).cost(report.figures))
        assert report.optimum <= min(report.tuned, report.present, report.rival_cost)
    assert sum(told) == steps(examples, grid)
