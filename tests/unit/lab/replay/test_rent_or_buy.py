"""The grid of rent-or-buy rules: each one, period by period, is what the definition says."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot_offload_core.fence.token import Site
from robot_offload_lab.replay.costs import Change, Weights, score
from robot_offload_lab.replay.heartbeats import Heartbeats
from robot_offload_lab.replay.limits import newest
from robot_offload_lab.replay.rent_or_buy import BACKS, OUTS, SILENCES_S, RentOrBuy, grid
from robot_offload_lab.replay.study import StudiedLink
from tests.unit.lab.replay.cases import example, link, made_case


def told_slowly(subject: StudiedLink, silence_s: float, out: float, back: float) -> float:
    """J of one rule, told in the words of the definition."""
    beats, weights = subject.beats, subject.weights
    period_s = beats.period_us / 1e6
    seen, site, regret, changes = newest(beats), Site.ROBOT, 0.0, []
    for index, at_us in enumerate(beats.sent_us.tolist()):
        bad = seen.latency_us[index] > subject.limit_us or seen.silent_us[index] > round(silence_s * 1e6)
        lost = bool(subject.forbidden[index])
        before = site
        if lost and site is Site.CLOUD:
            site, regret = Site.ROBOT, 0.0
        price = weights.exposed_per_s if site is Site.CLOUD else weights.wasted_per_s
        wrong = bad if site is Site.CLOUD else not bad
        regret = max(0.0, regret + (price if wrong else -price) * period_s)
        limit = weights.switch * (out if site is Site.CLOUD else back)
        if wrong and not lost and regret >= limit - 1e-9:
            site, regret = site.other, 0.0
        if site is not before:
            changes.append(Change(at_us, site))
    return score(changes, beats, subject.limit_us, weights).cost


def rules_of(subject: StudiedLink) -> dict[tuple[float, float, float], RentOrBuy]:
    found = grid(subject.beats, subject.limit_us, subject.weights, subject.forbidden)
    return {(rule.silence_s, rule.out, rule.back): rule for rule in found}


def test_the_grid_holds_every_combination_once() -> None:
    found = rules_of(made_case(link((2.0, 10))))
    assert len(found) == len(SILENCES_S) * len(OUTS) * len(BACKS) == 168


@pytest.mark.parametrize("limited", [True, False])
def test_every_rule_of_the_grid_costs_what_its_definition_says(limited: bool) -> None:
    subject = example("yard-4g.csv")
    subject = subject if limited else subject.unclamped
    found = rules_of(subject)
    chosen = [(s, out, back) for s in SILENCES_S for out in OUTS[::2] for back in BACKS[1::3]]
    for key in chosen:
        assert found[key].cost == pytest.approx(told_slowly(subject, *key)), key


PHASES = st.lists(
    st.tuples(st.sampled_from([0.02, 0.1, 0.3, 1.0]), st.sampled_from([10.0, 50.0, 70.0, 300.0, None])),
    min_size=1, max_size=12,
)  # fmt: skip


@settings(max_examples=40, deadline=None)
@given(PHASES, st.sampled_from(SILENCES_S), st.sampled_from(OUTS), st.sampled_from(BACKS))
def test_on_any_link_a_rule_costs_what_its_definition_says(
    phases: list[tuple[float, float | None]], silence_s: float, out: float, back: float
) -> None:
    subject = made_case(link((0.1, 10), *phases))
    assert rules_of(subject)[silence_s, out, back].cost == pytest.approx(told_slowly(subject, silence_s, out, back))


def test_who_never_returns_is_on_the_robot_all_the_time() -> None:
    subject = made_case(link((2.0, 10), (1.0, None), (2.0, 10)))
    never = rules_of(subject)[0.06, 0.4, math.inf]
    assert never.cost == pytest.approx(4.0)


def test_the_best_fixed_rule_is_between_the_optimum_and_all_others() -> None:
    subject = example("corridor-wifi.txt")
    costs = [rule.cost for rule in rules_of(subject).values()]
    assert subject.best.score.cost <= subject.best_fixed.cost == min(costs)
    assert subject.ratio_best_fixed(2 * min(costs)) == pytest.approx(2.0)


def test_other_prices_choose_other_rules() -> None:
    trace = link(*[(3.0, 10), (0.3, 300)] * 10)
    dear = made_case(trace, weights=Weights(10, 1, 5)).best_fixed
    cheap = made_case(trace, weights=Weights(10, 1, 0.01)).best_fixed
    assert dear.cost > cheap.cost


def test_before_the_first_heartbeat_nothing_is_known_to_be_good() -> None:
    period_us = 20_000
    sent_us = np.arange(10, dtype=np.int64) * period_us
    seen = newest(Heartbeats("made", period_us, sent_us, sent_us + 70_000))
    assert seen.silent_us.tolist()[:5] == [0, 20_000, 40_000, 60_000, 10_000]
    assert seen.latency_us.tolist()[3] > 10**12
    assert seen.latency_us.tolist()[4] == 70_000
