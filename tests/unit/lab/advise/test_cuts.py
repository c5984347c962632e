"""The best cuts: against every cut there is, on graphs of all kinds, and on graphs whose best cut is known."""

from __future__ import annotations

import itertools
import random

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from robot_offload_lab.advise.cuts import best_cuts
from robot_offload_lab.advise.model import Flow, Link, Part, Problem

_NAMES = tuple("abcdefghijkl")


@st.composite
def problems(draw: st.DrawFn) -> Problem:
    """Graphs of at most nine nodes that can move, with circles, many hearers and links that bear little."""
    names = _NAMES[: draw(st.integers(1, 9))]
    parts = {
        name: Part(name, draw(st.integers(0, 20)) / 10, movable=draw(st.booleans()), period_s=0.05) for name in names
    }
    flows = tuple(
        Flow(f"/{at}", draw(st.sampled_from(names)), tuple(sorted(draw(st.sets(st.sampled_from(names), max_size=3)))),
             draw(st.integers(0, 50)) * 1e4, 1000.0)
        for at in range(draw(st.integers(0, 10)))
    )  # fmt: skip
    flows += tuple(Flow("/cmd", name, (), 0.0, 100.0, commands=True) for name in names[:1])
    link = Link(draw(st.sampled_from([1e4, 2e5, 1e6])), draw(st.sampled_from([0.0, 0.02])))
    return Problem(parts, flows, link, draw(st.sampled_from([0.0, 0.03, 1.0])))


def every(problem: Problem) -> list[float]:
    """Returns the worth of every cut that the link bears, the best first."""
    sets = itertools.chain.from_iterable(
        itertools.combinations(problem.movable, size) for size in range(1, len(problem.movable) + 1)
    )
    return sorted((problem.value(it) for it in sets if problem.feasible(it)), reverse=True)


LOOP_TOO_LONG = Problem(
    {name: Part(name, 0.1 if name == "a" else 0.0, movable=name != "d", period_s=0.05) for name in "abcdefgh"},
    (Flow("/cmd", "a", (), 0.0, 100.0, commands=True),),
    Link(1e4, 0.0),
    0.0,
)
"""All that is worth moving must stay, and the bounds cannot know: every cut has to be looked at."""


@settings(max_examples=40, deadline=None)
@given(problems())
@example(LOOP_TOO_LONG)
def test_no_cut_is_better_than_those_that_are_advised(problem: Problem) -> None:
    advice = best_cuts(problem)
    assert advice.proven
    assert len(set(advice.cuts)) == len(advice.cuts)
    assert all(problem.feasible(cut) for cut in advice.cuts)
    assert [problem.value(cut) for cut in advice.cuts] == pytest.approx(every(problem)[:3], abs=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_the_cut_that_a_graph_was_made_around_is_found(seed: int) -> None:
    """Two crowds that talk much among themselves and little with each other: the movable one leaves as a whole."""
    rng = random.Random(seed)
    stay, leave = [f"r{i}" for i in range(15)], [f"c{i}" for i in range(15)]
    parts = {name: Part(name, rng.uniform(0.05, 0.5), movable=name in leave) for name in (*stay, *leave)}
    flows = [
        Flow(f"/{crowd[0]}{at}", *_two(rng, crowd), rng.uniform(5e5, 2e6), 1e4)
        for crowd in (stay, leave)
        for at in range(25)
    ]
    flows += [Flow(f"/over{at}", rng.choice(stay), (rng.choice(leave),), 1e4, 100.0) for at in range(4)]
    problem = Problem(parts, tuple(flows), Link(1e5, 0.01), 0.05)
    advice = best_cuts(problem)
    assert advice.cuts[0] == frozenset(leave)


def _two(rng: random.Random, crowd: list[str]) -> tuple[str, tuple[str, ...]]:
    publisher, hearer = rng.sample(crowd, 2)
    return publisher, (hearer,)


def test_nothing_is_advised_where_nothing_can_move() -> None:
    problem = Problem({"a": Part("a", 1.0)}, (), Link(1e6, 0.01), 0.03)
    assert best_cuts(problem).cuts == ()


def chain(rtt_s: float, tolerance_s: float, speedup: float = 1.0) -> Problem:
    """A sensor, a filter, a controller, wheels."""
    parts = {
        "laser": Part("laser", 0.1), "filter": Part("filter", 0.2, movable=True, period_s=0.05),
        "controller": Part("controller", 0.4, movable=True, period_s=0.05), "wheels": Part("wheels", 0.1),
    }  # fmt: skip
    flows = (
        Flow("/scan", "laser", ("filter",), 1e4), Flow("/clean", "filter", ("controller",), 1e4),
        Flow("/cmd_vel", "controller", ("wheels",), 1e3, commands=True),
    )  # fmt: skip
    return Problem(parts, flows, Link(1e6, rtt_s), tolerance_s, speedup)


def test_a_loop_may_take_no_longer_than_the_rule_allows() -> None:
    assert best_cuts(chain(0.02, 0.03)).cuts[0] == {"filter", "controller"}
    assert best_cuts(chain(0.04, 0.03)).cuts == (), "t_l = 40 ms and the periods are the same"
    assert best_cuts(chain(0.04, 0.03, speedup=2.0)).cuts[0] == {"filter", "controller"}, "50 ms are gained"


def test_a_cut_that_crosses_twice_pays_twice() -> None:
    [loop] = chain(0.02, 0.03).loops({"filter"})
    assert loop.link_s == pytest.approx(0.02), "there and back, then the controller on the robot"
    [loop] = chain(0.02, 0.03).loops({"controller"})
    assert loop.link_s == pytest.approx(0.02)
