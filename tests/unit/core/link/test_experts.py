"""The outlook: every rule is charged with what was true, and the one that did best here leads."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_offload_core.link import experts
from robot_offload_core.link.experts import (
    EVERYBODY,
    EXPERTS,
    FIRST,
    LONGEST_WAIT_S,
    NOBODY,
    Figures,
    LinkState,
    Outlook,
    Spells,
)
from robot_offload_core.link.prior import PRIOR
from tests.unit.core.builders import BEAT_S, NOW_S, SETTINGS, few

GOOD = LinkState(0.010, 0.010, bad=False)
SLOW = LinkState(0.200, 0.010, bad=True)
GONE = LinkState(1.0, 1.0, bad=True)


class Link:
    """A link lived through beat by beat; each beat of a good phase is echoed at once, of others never."""

    def __init__(self, outlook: Outlook | None = None) -> None:
        self.outlook = outlook or Outlook()
        self.now_s = NOW_S
        self.live(GOOD, BEAT_S)

    def live(self, seen: LinkState, duration_s: float) -> None:
        for _ in range(round(duration_s / BEAT_S)):
            self.now_s += BEAT_S
            if not seen.bad:
                self.outlook = experts.heard(self.outlook, self.now_s - seen.latency_s, seen.latency_s, SETTINGS)
            self.outlook = experts.advance(self.outlook, seen, SETTINGS, self.now_s)


def test_the_rule_that_was_best_on_other_links_leads_at_first() -> None:
    assert Outlook().leader == FIRST
    assert EXPERTS[FIRST].learnt == min(row[4] for row in PRIOR)


def test_before_anything_was_heard_nothing_happens() -> None:
    never = LinkState(float("inf"), float("inf"), bad=True)
    assert experts.advance(Outlook(), never, SETTINGS, NOW_S) == Outlook()


def test_on_a_link_that_stays_good_every_rule_is_in_the_cloud_after_the_longest_wait() -> None:
    link = Link()
    link.live(GOOD, LONGEST_WAIT_S + 2 * BEAT_S)
    assert link.outlook.clouds == EVERYBODY
    assert not any(link.outlook.regrets)


@few
@given(st.lists(st.tuples(st.sampled_from([GOOD, SLOW, GONE]), st.floats(0.02, 3.0)), max_size=8))
def test_whatever_happened_before_all_return_to_a_link_that_stays_good(phases: list[tuple[LinkState, float]]) -> None:
    link = Link()
    for seen, duration_s in phases:
        link.live(seen, duration_s)
        assert 0 <= link.outlook.clouds <= EVERYBODY
        assert all(charge >= 0 for charge in link.outlook.charges)
    link.live(GOOD, LONGEST_WAIT_S + 2 * BEAT_S)
    assert link.outlook.clouds == EVERYBODY
    assert experts.in_cloud(link.outlook)


def test_the_hard_limit_holds_for_every_rule() -> None:
    link = Link()
    link.live(GOOD, 10.0)
    link.live(GONE, BEAT_S)
    assert link.outlook.clouds == NOBODY


def test_after_us_standing_still_nothing_is_learnt_from_that_time() -> None:
    link = Link()
    link.live(GOOD, 10.0)
    before = link.outlook
    after = experts.advance(before, GONE, SETTINGS, link.now_s + 5.0)
    assert (after.clouds, after.charges, after.pending) == (before.clouds, before.charges, ())


def test_short_stalls_teach_to_stay() -> None:
    link = Link()
    for _ in range(40):
        link.live(GOOD, 6.0)
        link.live(SLOW, 0.14)
    leader = EXPERTS[link.outlook.leader]
    assert leader.out >= 1.0
    link.live(SLOW, 0.06)
    assert experts.in_cloud(link.outlook)


def test_long_slow_spells_teach_to_leave_at_once() -> None:
    link = Link()
    for _ in range(40):
        link.live(GOOD, 8.0)
        link.live(SLOW, 5.0)
    assert EXPERTS[link.outlook.leader].out <= 0.4
    link.live(GOOD, 10.0)
    link.live(SLOW, 0.06)
    assert not experts.in_cloud(link.outlook)


def test_a_link_that_is_never_good_for_long_teaches_to_wait() -> None:
    link = Link()
    for _ in range(60):
        for _ in range(4):
            link.live(GOOD, 0.6)
            link.live(GONE, 0.4)
        link.live(GOOD, 30.0)
    leader = EXPERTS[link.outlook.leader]
    assert leader.back >= 0.5 or leader.memory  # both wait: for long, or until few of the last beats were bad


def with_memory() -> int:
    """Returns the index of a rule that returns at once, but for its memory."""
    return min((i for i, e in enumerate(EXPERTS) if e.memory), key=lambda i: EXPERTS[i].back)


def test_a_rule_with_a_memory_stays_away_while_good_and_bad_alternate_and_returns_when_the_bad_ones_are_past() -> None:
    link = Link()
    link.live(GOOD, 10.0)
    index = with_memory()
    for _ in range(6):
        link.live(GONE, 0.3)
        link.live(GOOD, 0.3)
        assert not link.outlook.clouds >> index & 1
    link.live(GOOD, experts.LONGEST_MEMORY_S + 0.3)
    assert link.outlook.clouds >> index & 1


def test_one_lost_beat_in_a_second_keeps_no_memory_away() -> None:
    link = Link()
    link.live(GOOD, 10.0)
    link.live(GONE, 4 * BEAT_S)
    link.live(GOOD, 0.5)
    assert link.outlook.clouds >> with_memory() & 1


def test_nothing_older_than_the_longest_memory_is_kept() -> None:
    link = Link()
    for _ in range(20):
        link.live(GOOD, 0.2)
        link.live(GONE, 0.2)
    assert link.outlook.recent.bit_length() <= round(experts.LONGEST_MEMORY_S / BEAT_S)


def test_a_charge_is_true_and_known_one_limit_later() -> None:
    link = Link()
    link.live(GOOD, 10.0)
    link.live(SLOW, BEAT_S)
    sent_s, charged = link.now_s, sum(link.outlook.charges)
    late = experts.heard(link.outlook, sent_s, SETTINGS.allowed_loop_s + 0.010, SETTINGS)
    timely = experts.heard(link.outlook, sent_s, SETTINGS.allowed_loop_s, SETTINGS)
    assert charged <= sum(timely.charges) < sum(late.charges)


def test_one_lost_beat_is_normal_and_three_are_an_outage() -> None:
    for lost, turned in ((1, False), (4, True)):
        link = Link()
        link.live(GOOD, 1.0)
        for _ in range(lost):
            link.now_s += BEAT_S
            link.outlook = experts.advance(link.outlook, LinkState(0.010, 0.030, bad=False), SETTINGS, link.now_s)
        link.live(GOOD, 1.0)
        assert bool(link.outlook.spells.bad_s) is turned, lost


def test_charges_melt() -> None:
    charged = Outlook(ticked_s=NOW_S, clouds=EVERYBODY, charges=(8.0,) * len(EXPERTS), figures=Figures(half_life_s=1.0))
    link = Link(charged)
    link.live(GOOD, 3.0)
    assert max(link.outlook.charges) == pytest.approx(1.0, rel=0.05)


def test_a_margin_keeps_the_leader_from_changing_for_little() -> None:
    other = (FIRST + 1) % len(EXPERTS)
    cheap = [10.0] * len(EXPERTS)
    cheap[other] = 9.5
    for margin, leader in ((1.0, FIRST), (0.1, other)):
        outlook = Outlook(
            ticked_s=NOW_S, clouds=EVERYBODY, charges=tuple(cheap), figures=Figures(handicap=0.0, margin=margin)
        )
        link = Link(outlook)
        link.live(GOOD, 1.0)
        assert link.outlook.leader == leader


def test_the_lengths_of_spells_are_kept_and_their_median_is_told() -> None:
    link = Link()
    for length_s in (1.0, 2.0, 3.0):
        link.live(GOOD, 4.0)
        link.live(GONE, length_s)
    link.live(GOOD, 1.0)
    assert link.outlook.spells.bad_s == pytest.approx((1.0, 2.0, 3.0), abs=0.15)
    assert experts.usual_s(link.outlook.spells.bad_s) == pytest.approx(2.0, abs=0.15)
    assert experts.usual_s((1.0, 2.0)) is None
    assert Spells().good is None
