"""The price of a placement and the cheapest one of all."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot_offload_core.fence.token import Site
from robot_offload_lab.replay.costs import Change, Score, Weights, optimum, stretches
from tests.unit.lab.replay.cases import PERIOD_S, beats_of, link, made_case

PRICES = Weights(exposed_per_s=10, wasted_per_s=1, switch=0.5)


def test_exposed_and_wasted_time_and_switches_have_their_prices() -> None:
    subject = made_case(link((1.0, 10), (1.0, None), (1.0, 10))).unclamped
    changes = (Change(500_000, Site.CLOUD), Change(1_250_000, Site.ROBOT), Change(2_900_000, Site.CLOUD))
    found = subject.price(changes)
    assert found.exposed_s == pytest.approx(0.25)
    assert found.wasted_s == pytest.approx(0.5 + 0.9)
    assert found.switches == 3
    assert found.cloud_pct == pytest.approx(100 * (0.75 + 0.1) / 3)
    assert found.cost == pytest.approx(10 * 0.25 + 1.4 + 3 * 0.5)


def test_a_change_within_a_beat_period_is_reckoned_to_the_microsecond() -> None:
    subject = made_case(link((1.0, 10)))
    assert subject.price((Change(507_001, Site.CLOUD),)).wasted_s == pytest.approx(0.507001)


def test_acting_on_the_robot_always_wastes_the_good_time() -> None:
    subject = made_case(link((1.0, 10), (1.0, 300)))
    assert subject.price(()) == Score(exposed_s=0.0, wasted_s=1.0, switches=0, cloud_pct=0.0, cost=1.0)


def test_the_optimum_leaves_just_before_a_long_bad_stretch_and_returns_just_after() -> None:
    subject = made_case(link((3.0, 10), (1.0, None), (3.0, 10))).unclamped
    assert [(c.at_us, c.site) for c in subject.best.changes] == [
        (0, Site.CLOUD), (3_000_000, Site.ROBOT), (4_000_000, Site.CLOUD)
    ]  # fmt: skip
    assert subject.best.score.cost == pytest.approx(1.5)


def test_the_optimum_bears_a_bad_stretch_that_costs_less_than_two_switches() -> None:
    subject = made_case(link((3.0, 10), (0.08, None), (3.0, 10)))
    assert [c.site for c in subject.best.changes] == [Site.CLOUD]
    assert subject.best.score.cost == pytest.approx(0.5 + 0.8)


def test_the_optimum_stays_on_the_robot_when_the_good_time_does_not_pay_for_moving() -> None:
    subject = made_case(link((0.4, 10), (3.0, 300), (0.4, 10)))
    assert subject.best.changes == ()
    assert subject.ratio(subject.best.score.cost) == 1.0


def test_without_any_cost_of_the_optimum_there_is_no_ratio() -> None:
    subject = made_case(link((1.0, 300)))
    assert subject.best.score.cost == 0
    assert (subject.ratio(0.0), subject.ratio(0.1)) == (1.0, None)


@settings(max_examples=60)
@given(st.lists(st.booleans(), min_size=2, max_size=9), st.floats(0.1, 40), st.floats(0.01, 1.5))
def test_no_placement_at_all_is_cheaper_than_the_optimum(good: list[bool], exposed: float, switch: float) -> None:
    weights = Weights(exposed, 1.0, switch)
    subject = made_case(link((PERIOD_S, 10), *((PERIOD_S * 10, 10 if ok else 300) for ok in good)), weights=weights)
    # Where the link changes is up to the recording: a slow beat holds up those behind it.
    starts_us = [start_us for start_us, _, _ in stretches(subject.beats.good(subject.limit_us), 20_000)]
    best = subject.best.score.cost
    cheapest = min(
        subject.price(tuple(_changes(starts_us, sites))).cost
        for sites in itertools.product(Site, repeat=len(starts_us))
    )
    assert best == pytest.approx(cheapest)


def test_the_price_of_the_optimum_is_what_its_own_changes_come_to() -> None:
    beats = beats_of(link((2.0, 10), (0.5, 300), (2.0, 10), (5.0, None), (0.3, 10)))
    assert [c.reason for c in optimum(beats, 60_000, PRICES)] == ["Foresight"] * 4


def _changes(starts_us: list[int], sites: tuple[Site, ...]) -> list[Change]:
    before = (Site.ROBOT, *sites[:-1])
    return [Change(at, site) for at, was, site in zip(starts_us, before, sites, strict=True) if site is not was]
