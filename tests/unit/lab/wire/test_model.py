"""The emulated link's model: what happens to datagrams and to streams, in virtual time."""

from __future__ import annotations

import statistics
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_offload_lab.wire.link import ControlError, EmulatedLink
from robot_offload_lab.wire.model import (
    CLEAR,
    MSS,
    ConditionsError,
    DirectionModel,
    LinkConditions,
    StreamModel,
    WireError,
)
from robot_offload_lab.wire.schedule import Constant, Schedule, outage

conditions = st.builds(
    LinkConditions,
    delay_ms=st.floats(0, 500),
    jitter_ms=st.floats(0, 100),
    loss=st.floats(0, 1),
    rate_kbit_s=st.sampled_from([0.0, 100.0, 20_000.0]),
    queue_ms=st.sampled_from([0.0, 10.0, 150.0]),
    reorder=st.booleans(),
    cut=st.booleans(),
)
packets = st.lists(st.tuples(st.floats(0, 0.1), st.integers(0, 1500)), max_size=60)


def arrivals(here: LinkConditions, count: int, *, every_s: float = 0.02, size: int = 200, seed: int = 1) -> list[Any]:
    model = DirectionModel(seed, "up")
    return [model.datagram(index * every_s, size, here) for index in range(count)]


# Datagrams


def test_a_clear_link_passes_at_once() -> None:
    assert arrivals(CLEAR, 5) == [index * 0.02 for index in range(5)]


def test_a_delay_is_added_to_every_packet() -> None:
    assert arrivals(LinkConditions(delay_ms=40), 5) == pytest.approx([index * 0.02 + 0.04 for index in range(5)])


def test_a_cut_drops_everything() -> None:
    assert arrivals(LinkConditions(cut=True), 50) == [None] * 50


def test_the_share_of_losses_is_as_told() -> None:
    lost = arrivals(LinkConditions(loss=0.03), 20_000).count(None)
    assert 0.025 < lost / 20_000 < 0.035


def test_jitter_is_normal_around_the_delay_when_packets_are_far_apart() -> None:
    here = LinkConditions(delay_ms=40, jitter_ms=5)
    delays_ms = [(at - index) * 1000 for index, at in enumerate(arrivals(here, 5000, every_s=1.0))]
    assert statistics.mean(delays_ms) == pytest.approx(40, abs=0.5)
    assert statistics.stdev(delays_ms) == pytest.approx(5, abs=0.3)


def test_jitter_larger_than_the_delay_never_delivers_before_sending() -> None:
    here = LinkConditions(delay_ms=1, jitter_ms=50, reorder=True)
    assert all(at >= index * 0.02 for index, at in enumerate(arrivals(here, 2000)))


def test_order_is_kept_unless_reordering_is_allowed() -> None:
    kept = arrivals(LinkConditions(delay_ms=40, jitter_ms=30), 500)
    assert kept == sorted(kept)
    mixed = arrivals(LinkConditions(delay_ms=40, jitter_ms=30, reorder=True), 500)
    assert mixed != sorted(mixed)


def test_a_limited_rate_spaces_packets_out() -> None:
    here = LinkConditions(rate_kbit_s=100)  # 1250 bytes take 100 ms
    assert arrivals(here, 3, every_s=0.0, size=1250) == pytest.approx([0.1, 0.2, 0.3])


def test_a_full_queue_drops_the_newest() -> None:
    here = LinkConditions(rate_kbit_s=100, queue_ms=150)
    got = arrivals(here, 4, every_s=0.0, size=1250)
    assert got[:2] == pytest.approx([0.1, 0.2])
    assert got[2:] == [None, None]


def test_the_same_seed_tells_the_same_story_and_another_seed_another() -> None:
    here = LinkConditions(delay_ms=10, jitter_ms=5, loss=0.2)
    assert arrivals(here, 200, seed=4) == arrivals(here, 200, seed=4)
    assert arrivals(here, 200, seed=4) != arrivals(here, 200, seed=5)


def test_another_delay_loses_the_same_packets() -> None:
    lost = [at is None for at in arrivals(LinkConditions(loss=0.2), 200)]
    assert lost == [at is None for at in arrivals(LinkConditions(loss=0.2, delay_ms=80, jitter_ms=9), 200)]


@given(st.lists(conditions, min_size=1, max_size=5), packets, st.integers())
def test_a_datagram_arrives_after_its_sending_and_in_order(
    phases: list[LinkConditions], offers: list[tuple[float, int]], seed: int
) -> None:
    model = DirectionModel(seed, "down")
    now_s, latest_s = 0.0, 0.0
    for index, (pause_s, size) in enumerate(offers):
        now_s += pause_s
        here = phases[index % len(phases)]
        at_s = model.datagram(now_s, size, here)
        if at_s is None:
            assert here.cut or here.loss > 0 or here.queue_ms
            continue
        assert at_s >= now_s
        assert here.reorder or at_s >= latest_s
        latest_s = max(latest_s, 0.0 if here.reorder else at_s)


# Streams


def stream(seed: int = 1) -> StreamModel:
    return StreamModel(DirectionModel(seed, "up"))


def test_a_stream_is_delayed_like_datagrams() -> None:
    assert stream().offer(1.0, 100, LinkConditions(delay_ms=40), 0.08) == pytest.approx(1.04)


def test_a_lone_loss_costs_a_retransmission_time_out() -> None:
    model, lossy, fine = stream(), LinkConditions(delay_ms=40, loss=1), LinkConditions(delay_ms=40)
    assert model.offer(1.0, 100, lossy, 0.08) is None
    assert model.retry_at_s == pytest.approx(1.2), "max(200 ms, 2 x 80 ms)"
    assert model.retry(1.2, 100, fine) == pytest.approx(1.24)
    assert model.retry_at_s is None
    assert model.offer(1.3, 100, fine, 0.08) == pytest.approx(1.34)


def test_the_time_out_follows_a_long_round_trip() -> None:
    model = stream()
    model.offer(1.0, 100, LinkConditions(loss=1), 0.3)
    assert model.retry_at_s == pytest.approx(1.6)


def test_a_loss_in_a_busy_stream_costs_one_round_trip() -> None:
    model, fine = stream(), LinkConditions(delay_ms=40)
    for index in range(4):
        model.offer(1.0 + index * 0.02, 100, fine, 0.08)
    assert model.offer(1.08, 100, LinkConditions(delay_ms=40, loss=1), 0.08) is None
    assert model.retry_at_s == pytest.approx(1.16)


def test_a_loss_among_many_segments_of_one_write_costs_one_round_trip() -> None:
    model = stream()
    assert model.offer(1.0, 10 * MSS, LinkConditions(loss=1), 0.08) is None
    assert model.retry_at_s == pytest.approx(1.08)


def test_a_failed_fast_retransmission_is_followed_by_time_outs() -> None:
    model, cut = stream(), LinkConditions(cut=True)
    model.offer(1.0, 10 * MSS, LinkConditions(loss=1), 0.08)
    assert model.retry(1.08, 100, cut) is None
    assert model.retry_at_s == pytest.approx(1.28)
    assert model.retry(1.28, 100, cut) is None
    assert model.retry_at_s == pytest.approx(1.68)


def test_a_cut_holds_a_stream_and_backs_off() -> None:
    model, cut = stream(), LinkConditions(cut=True)
    assert model.offer(0.0, 100, cut, 0.02) is None
    tries_s = []
    while (at_s := model.retry_at_s) is not None and at_s < 4.0:
        tries_s.append(at_s)
        assert model.retry(at_s, 100, cut) is None
        assert model.offer(at_s + 0.01, 100, CLEAR, 0.02) is None, "what follows waits behind the hole"
    assert tries_s == pytest.approx([0.2, 0.6, 1.4, 3.0])
    assert model.retry_at_s == pytest.approx(6.2), "a cut of 4 s costs TCP 6.2 s"
    assert model.retry(6.2, 500, LinkConditions(delay_ms=10)) == pytest.approx(6.21)


def test_the_back_off_ends_at_a_minute() -> None:
    model, cut = stream(), LinkConditions(cut=True)
    model.offer(0.0, 100, cut, 0.02)
    for _ in range(20):
        before_s = model.retry_at_s
        assert before_s is not None
        model.retry(before_s, 100, cut)
    assert before_s is not None
    assert model.retry_at_s is not None
    assert model.retry_at_s - before_s == pytest.approx(60)


def test_what_was_held_still_passes_the_limited_rate() -> None:
    model = stream()
    model.offer(0.0, 100, LinkConditions(cut=True), 0.02)
    assert model.retry(0.2, 12_500, LinkConditions(rate_kbit_s=100)) == pytest.approx(1.2)


@given(st.lists(conditions, min_size=1, max_size=5), packets, st.integers())
def test_a_stream_loses_nothing_and_keeps_its_order(
    phases: list[LinkConditions], offers: list[tuple[float, int]], seed: int
) -> None:
    model = StreamModel(DirectionModel(seed, "up"))
    now_s, held, arrived, latest_s = 0.0, 0, 0, 0.0
    for index, (pause_s, size) in enumerate(offers):
        now_s += pause_s
        here = phases[index % len(phases)]
        while model.retry_at_s is not None and model.retry_at_s <= now_s:
            at_s = model.retry(model.retry_at_s, 100, here)
            if at_s is not None:
                assert at_s >= latest_s
                latest_s, arrived, held = at_s, arrived + held, 0
        at_s = model.offer(now_s, size, here, 0.05)
        if at_s is None:
            held += 1
            assert model.retry_at_s is not None
        else:
            assert held == 0
            assert at_s >= max(now_s, latest_s)
            latest_s, arrived = at_s, arrived + 1
    while model.retry_at_s is not None:
        assert held
        if model.retry(model.retry_at_s, 100, CLEAR) is not None:
            arrived, held = arrived + held, 0
    assert arrived == len(offers)


# Conditions


@given(conditions, conditions)
def test_conditions_in_a_row_are_never_better_than_each_alone(first: LinkConditions, second: LinkConditions) -> None:
    both = first.combined(second)
    for one in (first, second):
        assert both.delay_ms >= one.delay_ms
        assert both.jitter_ms >= one.jitter_ms * (1 - 1e-9)
        assert both.loss >= one.loss - 1e-9
        assert not one.rate_kbit_s or 0 < both.rate_kbit_s <= one.rate_kbit_s
        assert both.cut >= one.cut
    assert first.combined(CLEAR) == first
    assert CLEAR.combined(first) == first


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"delay_ms": -1}, "delay_ms must be a number of at least 0, found -1"),
        ({"jitter_ms": float("nan")}, "jitter_ms must be"),
        ({"loss": 1.5}, "loss must be a share from 0 to 1, found 1.5"),
    ],
)
def test_impossible_conditions_are_refused(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ConditionsError, match=message):
        LinkConditions(**values)


# The link as a whole


def test_the_schedule_runs_from_its_start_only() -> None:
    link = EmulatedLink(Schedule((outage(4, 20),)), seed=1)
    assert link.conditions(1000.0) == (CLEAR, CLEAR)
    assert link.next_change_s(1000.0) is None
    link.start(1000.0)
    assert link.next_change_s(1000.0) == 1016.0
    assert not link.conditions(1015.9)[0].cut
    assert link.conditions(1016.1)[0].cut
    assert link.conditions(1016.1)[1].cut


def test_overrides_replace_values_and_give_them_back() -> None:
    link = EmulatedLink(Schedule((Constant(LinkConditions(delay_ms=5), LinkConditions(delay_ms=7)),)), seed=1)
    link.override({"delay_ms": 80, "down": {"loss": 0.1}})
    up, down = link.conditions(0.0)
    assert (up.delay_ms, up.loss, down.delay_ms, down.loss) == (80, 0, 80, 0.1)
    link.override({"delay_ms": None, "cut": "up"})
    up, down = link.conditions(0.0)
    assert (up.delay_ms, up.cut, down.delay_ms, down.cut, down.loss) == (5, True, 7, False, 0.1)
    link.override({"cut": None})
    assert not link.conditions(0.0)[0].cut


@pytest.mark.parametrize(
    "changes",
    [{"cut": "left"}, {"cut": ["up"]}, {"delay": 3}, {"loss": 2}, {"delay_ms": "3"}, {"reorder": 1}, {"loss": True},
     {"up": 3}, {"up": {"cut": True}}],
)  # fmt: skip
def test_a_wrong_override_changes_nothing(changes: dict[str, Any]) -> None:
    link = EmulatedLink(Schedule(), seed=1)
    with pytest.raises(WireError):
        link.override({"delay_ms": 9, **changes})
    assert link.conditions(0.0) == (CLEAR, CLEAR)


def test_an_unknown_condition_is_told_the_known_ones() -> None:
    with pytest.raises(ControlError, match=r"unknown condition 'delay'; known are delay_ms, jitter_ms, loss"):
        EmulatedLink(Schedule(), seed=1).override({"delay": 3})


def test_a_stream_is_not_given_room_that_would_fill_the_queue_for_others() -> None:
    narrow = LinkConditions(rate_kbit_s=100, queue_ms=100)
    link = EmulatedLink(Schedule((Constant(narrow, CLEAR),)), seed=1)
    model = link.stream("up")
    now_s = 0.0
    for _ in range(50):
        size, wait_s = link.room("up", now_s)
        if size:
            link.offer("up", model, now_s, size)
        else:
            assert wait_s > 0
            now_s += wait_s
    assert link.room("down", now_s) == (65536, 0.0)
    late_s = link.datagram("up", now_s, 10)
    assert late_s is not None, "a datagram still finds its place"
    assert late_s - now_s < 0.15
