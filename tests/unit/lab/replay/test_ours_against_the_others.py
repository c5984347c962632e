"""Our rule beside the best fixed rule, on kinds of links that had no part in finding its figures; and the search."""

from __future__ import annotations

import statistics

import pytest

from robot_offload_lab.links.made_up import FAMILIES, made
from robot_offload_lab.replay.named import CONSTANT, OURS, POLICIES
from robot_offload_lab.replay.study import StudiedLink, outcome
from robot_offload_lab.replay.tune import DEFAULT, GRID, Figures, Sights, search, steps
from tests.unit.lab.replay.cases import EXAMPLES, example, made_case

HELD_OUT = [name for name, family in FAMILIES.items() if family.held_out]
DURATION_S = 300.0


def test_on_unseen_kinds_of_links_our_rule_is_as_good_as_the_best_fixed_one_in_hindsight() -> None:
    ratios = []
    for name in HELD_OUT:
        subject = made_case(made(name, 1, DURATION_S), FAMILIES[name].tolerance_s)
        costs = {each: outcome(policy, subject).score.cost for each, policy in POLICIES.items() if each not in CONSTANT}
        ours = costs[OURS.name]
        assert ours >= subject.best.score.cost
        slack = 5 * DURATION_S / 3600
        assert ours <= 1.25 * subject.best_fixed.cost + slack, name
        ratios.append((ours - slack) / subject.best_fixed.cost)
    assert statistics.mean(ratios) <= 1.05


@pytest.fixture(scope="module")
def examples() -> list[StudiedLink]:
    return [example(name) for name in EXAMPLES]


def test_the_search_drives_the_same_rule_as_the_replay(examples: list[StudiedLink]) -> None:
    for subject in examples:
        assert Sights(subject).cost(DEFAULT) == pytest.approx(outcome(OURS, subject).score.cost)


def test_the_present_figures_are_among_those_that_are_searched() -> None:
    assert DEFAULT in GRID


def test_a_report_tells_of_a_recording_that_was_not_searched(examples: list[StudiedLink]) -> None:
    grid = (Figures(hold_down_initial_s=0.25), Figures(handicap=10.0), Figures(margin=0.2, half_life_s=100.0))
    told: list[int] = []
    reports = search(examples, (), outcome, told.append, grid)
    assert [(report.trace, report.trained_on) for report in reports] == [
        ("corridor-wifi.txt", ("yard-4g.csv",)),
        ("yard-4g.csv", ("corridor-wifi.txt",)),
    ]
    for index, report in enumerate(reports):
        elsewhere = Sights(examples[1 - index])
        assert report.figures == min(grid, key=elsewhere.cost)
        assert report.tuned == pytest.approx(Sights(examples[index]).cost(report.figures))
        assert report.optimum <= min(report.tuned, report.present, report.rival_cost, report.best_fixed)
    assert sum(told) == steps(examples, (), grid)
