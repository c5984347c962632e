"""Searches figures of our rule on some recordings and reports on another one, never on the same."""

from __future__ import annotations

import dataclasses
import itertools
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from robot_offload_core.fence.token import Site
from robot_offload_core.link import experts
from robot_offload_core.link.experts import USUAL
from robot_offload_core.words.settings import Settings
from robot_offload_lab.replay.costs import Change
from robot_offload_lab.replay.named import CONSTANT, OURS, POLICIES, NamedPolicy
from robot_offload_lab.replay.ours import Eyes, Mind, Sight
from robot_offload_lab.replay.play import moments
from robot_offload_lab.replay.study import Replayed, StudiedLink

RIVALS: Final = tuple(name for name in POLICIES if name not in (OURS.name, *CONSTANT))


@dataclass(frozen=True)
class Figures:
    """What is searched: the first hold-down is set in the resource, the rest is in the core's outlook.

    Attributes:
        hold_down_initial_s: `switching.holdDown.initial`, the wait after the first flap.
        handicap, margin, half_life_s: see `robot_offload_core.link.experts.Figures`.
    """

    hold_down_initial_s: float = Settings.hold_down_initial_s
    handicap: float = USUAL.handicap
    margin: float = USUAL.margin
    half_life_s: float = USUAL.half_life_s


DEFAULT: Final = Figures()
GRID: Final[tuple[Figures, ...]] = tuple(
    itertools.starmap(Figures, itertools.product((0.5, 1.0), (1.0, 3.0, 10.0), (0.5, 1.0), (300.0, 1000.0)))
)
"""Every combination that is tried, the present figures included."""


@dataclass(frozen=True)
class TuningReport:
    """One recording that was left out of the search.

    Attributes:
        trace: its name.
        trained_on: the others.
        figures: the best figures on the others.
        tuned, present: cost on this recording with those figures, and with the present ones.
        rival, rival_cost: the best other rule on this recording.
        best_fixed: cost of the best fixed rule, in hindsight.
        optimum: the lowest possible cost.
    """

    trace: str
    trained_on: tuple[str, ...]
    figures: Figures
    tuned: float
    present: float
    rival: str
    rival_cost: float
    best_fixed: float
    optimum: float


class Sights:
    """What an agent would know at each moment of a recording: computed once, as it does not depend on the figures."""

    def __init__(self, subject: StudiedLink) -> None:
        eyes, sent_us = Eyes(subject.settings), subject.beats.sent_us.tolist()
        self._case = subject
        self._sights: list[tuple[int, list[float], Sight]] = []
        for at_us, echoes in moments(subject.beats):
            sent_s = [sent_us[index] / 1e6 for index in echoes]
            for each_s in sent_s:
                eyes.heard(each_s, at_us / 1e6)
            self._sights.append((at_us, sent_s, eyes.look(at_us / 1e6)))

    def cost(self, figures: Figures) -> float:
        """Return the cost of our rule with these figures."""
        settings = dataclasses.replace(self._case.settings, hold_down_initial_s=figures.hold_down_initial_s)
        mind = Mind(settings, experts.Figures(figures.handicap, figures.margin, figures.half_life_s))
        site, changes = Site.ROBOT, []
        for at_us, sent_s, sight in self._sights:
            for each_s in sent_s:
                mind.heard(each_s, at_us / 1e6)
            wanted = mind.place(sight).site
            if wanted is not site:
                site = wanted
                changes.append(Change(at_us, site))
        return self._case.price(tuple(changes)).cost


def search(
    cases: Sequence[StudiedLink],
    held_out: Sequence[StudiedLink],
    outcome: Callable[[NamedPolicy, StudiedLink], Replayed],
    done: Callable[[int], None],
    grid: Sequence[Figures] = GRID,
) -> list[TuningReport]:
    """Find the figures with the lowest mean ratio on some recordings, and report on others.

    Args:
        cases: to search on.
        held_out: to report on; without them each of `cases` in turn is left out of the search and reported on.
        outcome: replays a recording for a policy.
        done: called with the number of further steps done, of `steps(cases, held_out)`.
        grid: the figures that are tried.
    """
    everything = [*cases, *held_out]
    costs: list[dict[Figures, float]] = []
    for subject in everything:
        sights = Sights(subject)
        done(1)
        costs.append({})
        for figures in dict.fromkeys([DEFAULT, *grid]):
            costs[-1][figures] = sights.cost(figures)
            done(1)
    reported = range(len(cases), len(everything)) if held_out else range(len(cases))
    reports = []
    for index in reported:
        subject = everything[index]
        others = [other for other in range(len(cases)) if other != index]
        best = min(grid, key=lambda figures: _mean_ratio(everything, costs, others, figures))
        rivals = {name: outcome(POLICIES[name], subject).score.cost for name in RIVALS}
        done(1)
        rival = min(rivals, key=lambda name: rivals[name])
        names = tuple(everything[other].beats.name for other in others)
        cost = costs[index]
        reports.append(
            TuningReport(subject.beats.name, names, best, cost[best], cost[DEFAULT], rival, rivals[rival],
                   subject.best_fixed.cost, subject.best.score.cost)
        )  # fmt: skip
    return reports


def steps(cases: Sequence[StudiedLink], held_out: Sequence[StudiedLink] = (), grid: Sequence[Figures] = GRID) -> int:
    """Return how many steps `search` reports."""
    return (len(cases) + len(held_out)) * (len(dict.fromkeys([DEFAULT, *grid])) + 1) + len(held_out or cases)


def _mean_ratio(
    cases: Sequence[StudiedLink], costs: Sequence[dict[Figures, float]], chosen: Sequence[int], figures: Figures
) -> float:
    """Return the mean ratio over the chosen recordings; one whose optimum costs nothing counts with its cost."""
    ratios = []
    for index in chosen:
        ratio = cases[index].ratio(costs[index][figures])
        ratios.append(costs[index][figures] if ratio is None else ratio)
    return statistics.mean(ratios)
