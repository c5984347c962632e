"""Searches figures of our rule on some recordings and reports on another one, never on the same."""

from __future__ import annotations

import dataclasses
import itertools
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from robot_offload.replay.costs import Change
from robot_offload.replay.named import CONSTANT, OURS, POLICIES, NamedPolicy
from robot_offload.replay.ours import Eyes, Mind, Sight
from robot_offload.replay.play import moments
from robot_offload.replay.study import Case, Outcome
from robot_offload_core.policy import Fitness, Rule, Verdict
from robot_offload_core.settings import Settings
from robot_offload_core.token import Site

GOOD: Final = Fitness(True, "LinkGood", "")
SLOW: Final = Fitness(False, "LatencyTooHigh", "")
RIVALS: Final = tuple(name for name in POLICIES if name not in (OURS.name, *CONSTANT))


@dataclass(frozen=True)
class Figures:
    """What is searched: the first hold-down is set in the resource, the rest stands in the core's `Rule`.

    Attributes:
        hold_down_initial_s: `switching.holdDown.initial`, the wait after the first flap.
        patience_s, patience_max_s, proof_max_s: see `robot_offload_core.policy.Rule`.
    """

    hold_down_initial_s: float = Settings.hold_down_initial_s
    patience_s: float = Rule.patience_s
    patience_max_s: float = Rule.patience_max_s
    proof_max_s: float = Rule.proof_max_s


DEFAULT: Final = Figures()
GRID: Final[tuple[Figures, ...]] = tuple(
    itertools.starmap(Figures, itertools.product((0.25, 0.5, 1.0, 2.0), (0.1, 0.2), (0.5, 1.0), (1.0, 2.0, 4.0)))
)
"""Every combination that is tried; the present figures are among them."""


@dataclass(frozen=True)
class Report:
    """One recording that was left out of the search.

    Attributes:
        trace: its name; trained_on: the others.
        figures: the best ones on the others.
        tuned, present: cost on this recording with these figures, and with the present ones.
        rival, rival_cost: the best other rule here.
        optimum: the least cost that was possible.
    """

    trace: str
    trained_on: tuple[str, ...]
    figures: Figures
    tuned: float
    present: float
    rival: str
    rival_cost: float
    optimum: float


class Sights:
    """What an agent would know at each moment of a recording: the same whatever the figures are, so found once."""

    def __init__(self, subject: Case) -> None:
        eyes, sent_us = Eyes(subject.settings), subject.beats.sent_us.tolist()
        self._case = subject
        self._sights: list[tuple[int, Sight]] = []
        faults: dict[str, Verdict] = {}
        for at_us, echoes in moments(subject.beats):
            for index in echoes:
                eyes.heard(sent_us[index] / 1e6, at_us / 1e6)
            seen = eyes.look(at_us / 1e6)
            fault = seen.fault and faults.setdefault(seen.fault.reason, seen.fault)  # one object for a million moments
            kept = Sight(seen.now_s, GOOD if seen.fitness.ok else SLOW, fault, seen.good_s)
            self._sights.append((at_us, kept))

    def cost(self, figures: Figures) -> float:
        """What our rule with these figures comes to."""
        settings = dataclasses.replace(self._case.settings, hold_down_initial_s=figures.hold_down_initial_s)
        rule = Rule(
            patience_s=figures.patience_s, patience_max_s=figures.patience_max_s, proof_max_s=figures.proof_max_s
        )  # fmt: skip
        mind, site = Mind(settings, rule), Site.ROBOT
        changes: list[Change] = []
        for at_us, sight in self._sights:
            wanted = mind.place(sight).site
            if wanted is not site:
                site = wanted
                changes.append(Change(at_us, site))
        return self._case.price(tuple(changes)).cost


def leave_one_out(
    cases: Sequence[Case],
    outcome: Callable[[NamedPolicy, Case], Outcome],
    done: Callable[[int], None],
    grid: Sequence[Figures] = GRID,
) -> list[Report]:
    """Each recording in turn is left out: the figures with the least mean ratio on the others are tried on it.

    Args:
        cases: at least two.
        outcome: replays a recording for a policy.
        done: told how many steps of `steps(cases)` more are done.
        grid: what is tried.
    """
    costs: list[dict[Figures, float]] = []
    for subject in cases:
        sights = Sights(subject)
        done(1)
        costs.append({})
        for figures in dict.fromkeys([DEFAULT, *grid]):
            costs[-1][figures] = sights.cost(figures)
            done(1)
    reports = []
    for index, subject in enumerate(cases):
        others = [other for other in range(len(cases)) if other != index]
        best = min(grid, key=lambda figures: _mean_ratio(cases, costs, others, figures))
        rivals = {name: outcome(POLICIES[name], subject).score.cost for name in RIVALS}
        done(1)
        rival = min(rivals, key=lambda name: rivals[name])
        names = tuple(cases[other].beats.name for other in others)
        cost = costs[index]
        reports.append(
            Report(subject.beats.name, names, best, cost[best], cost[DEFAULT], rival, rivals[rival],
                   subject.best.score.cost)
        )  # fmt: skip
    return reports


def steps(cases: Sequence[Case], grid: Sequence[Figures] = GRID) -> int:
    """How many steps `leave_one_out` tells."""
    return len(cases) * (len(dict.fromkeys([DEFAULT, *grid])) + 2)


def _mean_ratio(
    cases: Sequence[Case], costs: Sequence[dict[Figures, float]], chosen: Sequence[int], figures: Figures
) -> float:
    """Of the chosen recordings; a recording whose optimum is nothing counts with its cost."""
    ratios = []
    for index in chosen:
        ratio = cases[index].ratio(costs[index][figures])
        ratios.append(costs[index][figures] if ratio is None else ratio)
    return statistics.mean(ratios)
