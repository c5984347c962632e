"""Link health: round trips of one clock, estimates of the other within their stated uncertainty."""

from __future__ import annotations

from dataclasses import dataclass, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_offload_core.link import links
from robot_offload_core.link.links import OFFSET_LIFE_S, WINDOW_SAMPLES, Link, Offset
from robot_offload_core.words.beats import Beat, Echo
from tests.unit.core.builders import BEAT_S, CLOUD, NOW_S, ROBOT, STRANGER, cloud_beat, good_link, many, us

ROUNDING_S = 3e-6
"""Beats carry whole microseconds: three of them enter an estimate."""


def heard(link: Link, beat: Beat, arrived_s: float = NOW_S) -> Link:
    return links.hear(link, beat, ROBOT, arrived_s, wall_us=0)


def echo_of(sent_s: float, hold_s: float = 0.0, incarnation: str = ROBOT) -> Echo:
    return Echo(incarnation, 1, us(sent_s), us(hold_s))


ways = st.floats(20e-6, 0.3)
"""One-way times; none is shorter than a few roundings."""

# -- round trips


@many
@given(ways, ways, st.floats(0, 0.1), st.floats(-1e5, 1e5))
def test_the_round_trip_is_both_ways_without_the_hold_whatever_the_other_clock_shows(
    up_s: float, down_s: float, hold_s: float, offset_s: float
) -> None:
    sent_s = NOW_S - down_s - hold_s - up_s
    beat = cloud_beat(2e5 + offset_s, echo=echo_of(sent_s, hold_s))
    assert heard(Link(), beat).round_trip_s == pytest.approx(up_s + down_s, abs=ROUNDING_S)


def test_an_echo_of_anybody_elses_beat_proves_nothing() -> None:
    link = heard(good_link(NOW_S - BEAT_S), cloud_beat(echo=echo_of(NOW_S - 0.004, incarnation=STRANGER)))
    before = good_link(NOW_S - BEAT_S)
    counted = replace(before, last_sequence=link.last_sequence, received=before.received + 1)
    assert link == replace(counted, heard_s=NOW_S, sent_us=cloud_beat().sent_us)


def test_a_beat_without_an_echo_is_heard_and_proves_no_round_trip() -> None:
    link = heard(Link(), cloud_beat(echo=None))
    assert (link.heard_s, link.received) == (NOW_S, 1)
    assert (link.echo_sent_s, link.round_trip_s, link.window, link.offset) == (None, None, (), None)


def test_an_echo_from_the_future_proves_nothing() -> None:
    assert heard(Link(), cloud_beat(echo=echo_of(NOW_S + 0.001))).echo_sent_s is None


def test_a_hold_longer_than_the_loop_proves_nothing() -> None:
    assert heard(Link(), cloud_beat(echo=echo_of(NOW_S - 0.010, hold_s=0.020))).echo_sent_s is None


def test_the_loop_does_not_grow_younger_backwards_by_an_old_echo() -> None:
    link = good_link(NOW_S - BEAT_S)
    after = heard(link, cloud_beat(echo=echo_of(NOW_S - 1.0)))
    assert (after.echo_sent_s, after.window) == (link.echo_sent_s, link.window)


def test_another_incarnation_starts_a_new_link() -> None:
    link = heard(good_link(NOW_S - BEAT_S), cloud_beat(incarnation=STRANGER, sequence=7, echo=None))
    sent_us = cloud_beat().sent_us
    assert link == Link(peer=STRANGER, heard_s=NOW_S, sent_us=sent_us, first_sequence=7, last_sequence=7, received=1)


def test_the_window_keeps_the_newest_round_trips_only() -> None:
    link = Link()
    for index in range(WINDOW_SAMPLES + 50):
        now_s = NOW_S + index * BEAT_S
        link = heard(link, cloud_beat(now_s, echo=echo_of(now_s - index * 1e-3)), now_s)
    assert len(link.window) == WINDOW_SAMPLES
    assert link.window[-1] == pytest.approx((WINDOW_SAMPLES + 49) * 1e-3)


# -- lost beats


def after_sequences(*numbers: int) -> Link:
    link = Link()
    for index, number in enumerate(numbers):
        now_s = NOW_S + index * BEAT_S
        link = heard(link, cloud_beat(now_s, sequence=number, echo=None), now_s)
    return link


@pytest.mark.parametrize(
    ("numbers", "share"),
    [((5,), 0.0), ((5, 6, 7, 8), 0.0), ((5, 8), 0.5), ((0, 10), 9 / 11), ((5, 8, 0, 1, 2), 0.0)],
    ids=["one", "none lost", "two of four", "nine of eleven", "pulse process restarted"],
)
def test_the_share_of_lost_beats_is_told_by_their_numbers(numbers: tuple[int, ...], share: float) -> None:
    assert links.health(after_sequences(*numbers), NOW_S).loss_share == pytest.approx(share)


def test_a_restarted_pulse_process_does_not_start_a_new_link() -> None:
    link = heard(good_link(NOW_S - BEAT_S), cloud_beat(sequence=0))
    assert link.peer == CLOUD
    assert len(link.window) == len(good_link().window) + 1


# -- copies


@pytest.mark.parametrize("late_s", [0.0, 0.3], ids=["doubled", "over a way that takes 300 ms longer"])
def test_a_copy_of_the_newest_beat_changes_nothing(late_s: float) -> None:
    beat = cloud_beat(NOW_S - 0.010, NOW_S - 0.020)
    link = heard(good_link(NOW_S - BEAT_S), beat)
    assert heard(link, beat, NOW_S + late_s) is link


def test_a_beat_that_was_overtaken_changes_nothing() -> None:
    link = heard(good_link(NOW_S - BEAT_S), cloud_beat())
    assert heard(link, cloud_beat(NOW_S - 0.4, NOW_S - 0.41), NOW_S + BEAT_S) is link


# -- two clocks


@dataclass(frozen=True)
class Clocks:
    """A pair of hosts: the other one's steady clock shows ours plus `steady_s`, its system clock ours plus `wall_s`."""

    steady_s: float
    wall_s: float

    def beat(self, sent_s: float, up_s: float, hold_s: float, down_s: float) -> tuple[Beat, float]:
        """The beat that answers ours of `sent_s`, and when it arrives here."""
        there_s = sent_s + up_s + hold_s
        wall_us = us(1e6 + self.wall_s - self.steady_s)
        beat = cloud_beat(there_s + self.steady_s, echo=echo_of(sent_s, hold_s), wall_us=wall_us)
        return beat, there_s + down_s


clocks = st.builds(Clocks, st.floats(-500, 1e6), st.floats(-5, 5))
exchanges = st.lists(st.tuples(ways, st.floats(0, 0.05), ways), min_size=1, max_size=25)


def talked(pair: Clocks, talk: list[tuple[float, float, float]]) -> Link:
    """The link after one exchange every second; our system clock is a million seconds ahead of our steady clock."""
    link = Link()
    for index, (up_s, hold_s, down_s) in enumerate(talk):
        beat, arrived_s = pair.beat(NOW_S + index, up_s, hold_s, down_s)
        link = links.hear(link, beat, ROBOT, arrived_s, us(1e6))
    return link


@many
@given(clocks, exchanges)
def test_the_true_offset_lies_within_the_stated_uncertainty(
    pair: Clocks, talk: list[tuple[float, float, float]]
) -> None:
    offset = talked(pair, talk).offset
    assert offset is not None
    assert abs(offset.steady_s - pair.steady_s) <= offset.uncertainty_s + ROUNDING_S
    assert abs(offset.wall_s - pair.wall_s) <= offset.uncertainty_s + ROUNDING_S


@many
@given(clocks, exchanges)
def test_the_one_way_estimate_lies_within_the_stated_uncertainty(
    pair: Clocks, talk: list[tuple[float, float, float]]
) -> None:
    link = talked(pair, talk)
    assert link.down_s is not None
    assert link.offset is not None
    assert abs(link.down_s - talk[-1][2]) <= link.offset.uncertainty_s + 2 * ROUNDING_S


@many
@given(clocks, exchanges)
def test_clocks_are_never_said_to_differ_by_more_than_they_do(
    pair: Clocks, talk: list[tuple[float, float, float]]
) -> None:
    assert links.clock_excess_s(talked(pair, talk)) <= abs(pair.wall_s) + ROUNDING_S


def test_the_exchange_with_the_least_round_trip_gives_the_offset() -> None:
    link = talked(Clocks(5.0, 0.0), [(0.100, 0, 0.020), (0.001, 0, 0.001), (0.020, 0, 0.100)])
    assert link.offset is not None
    assert link.offset.uncertainty_s == pytest.approx(0.001, abs=ROUNDING_S)
    assert link.offset.steady_s == pytest.approx(5.0, abs=ROUNDING_S)


def test_a_better_but_old_exchange_gives_way_because_quartzes_drift() -> None:
    pair = Clocks(5.0, 0.0)
    link = talked(pair, [(0.001, 0, 0.001)])
    beat, arrived_s = pair.beat(NOW_S + OFFSET_LIFE_S + 1, 0.050, 0, 0.050)
    link = links.hear(link, beat, ROBOT, arrived_s, us(1e6))
    assert link.offset is not None
    assert link.offset.uncertainty_s == pytest.approx(0.050, abs=ROUNDING_S)


def test_a_system_clock_that_was_set_shows_in_the_next_beat() -> None:
    link = talked(Clocks(5.0, 0.0), [(0.001, 0, 0.001)])
    beat, arrived_s = Clocks(5.0, 3.0).beat(NOW_S + 1, 0.100, 0, 0.100)
    link = links.hear(link, beat, ROBOT, arrived_s, us(1e6))
    assert links.clock_excess_s(link) == pytest.approx(3.0 - 0.001, abs=2 * ROUNDING_S)


def test_a_steady_clock_that_stood_still_shows_in_the_next_beat() -> None:
    link = talked(Clocks(5.0, 0.0), [(0.001, 0, 0.001)])
    beat, arrived_s = Clocks(4.0, 0.0).beat(
        NOW_S + 1, 0.100, 0, 0.100
    )  # a paused virtual machine, its system clock set
    link = links.hear(link, beat, ROBOT, arrived_s, us(1e6))
    assert links.clock_excess_s(link) == 0.0


def test_nothing_is_said_of_clocks_before_an_echo() -> None:
    assert links.clock_excess_s(Link()) == 0.0


def test_a_difference_within_the_uncertainty_is_none() -> None:
    assert links.clock_excess_s(Link(offset=Offset(0.0, -0.030, 0.040, NOW_S))) == 0.0
    assert links.clock_excess_s(Link(offset=Offset(0.0, -0.050, 0.040, NOW_S))) == pytest.approx(0.010)


# -- latency and the summary


def test_the_latency_of_a_healthy_loop_is_its_newest_round_trip() -> None:
    link = good_link(round_trip_s=0.030)
    assert links.latency_s(link, NOW_S + 2 * BEAT_S, BEAT_S) == pytest.approx(0.030, abs=ROUNDING_S)


def test_an_overdue_echo_raises_the_latency_before_it_arrives() -> None:
    link = good_link(round_trip_s=0.030)
    shown = [links.latency_s(link, NOW_S + late_s, BEAT_S) for late_s in (0.0, 0.050, 0.100, 0.200)]
    assert shown == pytest.approx([0.030, 0.040, 0.090, 0.190], abs=ROUNDING_S)


def test_the_latency_of_a_silent_link_is_unbounded() -> None:
    assert links.latency_s(Link(), NOW_S, BEAT_S) == float("inf")
    assert links.latency_s(heard(Link(), cloud_beat(echo=None)), NOW_S, BEAT_S) == float("inf")


def test_the_summary_of_nothing_is_nothing() -> None:
    summary = links.health(Link(), NOW_S)
    assert {value for name, value in vars(summary).items() if name != "loss_share"} == {None}


def test_the_summary_of_a_good_link_shows_its_figures_in_milliseconds() -> None:
    summary = links.health(good_link(round_trip_s=0.010), NOW_S + 0.007)
    assert (summary.age_ms, summary.loop_age_ms) == (7.0, 17.0)
    assert {summary.round_trip_p50_ms, summary.round_trip_p90_ms, summary.round_trip_p99_ms} == {10.0}
    assert (summary.up_ms, summary.down_ms, summary.one_way_uncertainty_ms) == (5.0, 5.0, 5.0)
    assert (summary.clock_offset_ms, summary.loss_share) == (0.0, 0.0)


@many
@given(st.lists(st.floats(0, 10), min_size=1, max_size=300), st.sampled_from([0.5, 0.9, 0.99]))
def test_at_least_the_share_of_all_values_does_not_exceed_the_quantile(values: list[float], share: float) -> None:
    found = links.quantile(sorted(values), share)
    assert found in values
    assert sum(value <= found for value in values if found is not None) >= share * len(values)


def test_nothing_has_no_quantile() -> None:
    assert links.quantile([], 0.5) is None
