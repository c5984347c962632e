"""From round trips to heartbeats: stalls hold, losses lose, nobody overtakes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_offload_lab.links.recorded import TraceError, parse_trace
from robot_offload_lab.replay.heartbeats import NEVER_US
from tests.unit.lab.replay.cases import beats_of, link, text


def latencies_ms(*rtts_ms: float) -> list[float]:
    return [latency_us / 1e3 for latency_us in beats_of(text(*rtts_ms)).latency_us.tolist()]


def test_a_beat_is_back_after_the_round_trip_of_the_moment_at_which_it_left() -> None:
    assert latencies_ms(20, 30, 10, 20) == [20, 30, 30, 20], "the samples begin at 0, 20, 50 and 60 ms"


def test_a_beat_sent_during_a_stall_is_back_at_its_end() -> None:
    found = latencies_ms(20, 20, 100, 20, 20)
    assert found == [20, 20, 100, 80, 60, 40, 20, 20, 20]


def test_a_long_sample_on_a_slow_link_is_no_stall() -> None:
    found = latencies_ms(100, 100, 250, 100)
    assert found[10:12] == [250, 250], "each beat takes it whole: 250 ms is less than three medians"


def test_no_beat_overtakes_an_earlier_one() -> None:
    beats = beats_of(text(*[60] * 5, 170, *[60] * 5))
    assert np.all(np.diff(beats.arrived_us) >= 0)
    assert beats.latency_us[23] / 1e3 == 170, "sent at 460 ms"
    assert beats.latency_us[24] / 1e3 == 150, "sent at 480 ms over a link of 60 ms, but behind the one before"


def test_beats_sent_while_requests_are_lost_never_come_back() -> None:
    beats = beats_of(link((0.1, 10), (0.1, None), (0.1, 10)))
    assert (beats.arrived_us == NEVER_US).tolist() == [False] * 5 + [True] * 5 + [False] * 5
    assert not beats.good(10**9)[5:10].any(), "not even with an endless tolerance"


def test_between_the_end_of_a_stall_and_the_next_request_a_beat_takes_a_median() -> None:
    beats = beats_of(parse_trace("t_s,rtt_ms\n0,10\n0.1,10\n0.2,50\n0.3,10\n", name="made"))
    assert (beats.latency_us[10:15] / 1e3).tolist() == [50, 30, 10, 10, 10]


def test_only_whole_periods_are_replayed() -> None:
    beats = beats_of(text(30, 30, 30))
    assert (len(beats.sent_us), beats.duration_us) == (4, 80_000)


def test_a_recording_of_less_than_two_beats_is_refused() -> None:
    with pytest.raises(TraceError, match="made: the recording is shorter than two heartbeats"):
        beats_of(text(10, 20))


@given(st.lists(st.one_of(st.none(), st.integers(1, 900)), min_size=2, max_size=40))
def test_every_beat_is_back_in_order_after_it_was_sent_or_never(rtts_ms: list[int | None]) -> None:
    if all(rtt is None for rtt in rtts_ms):
        rtts_ms = [*rtts_ms, 5]
    lines = [f"{index / 20:.2f},{'' if rtt is None else rtt}" for index, rtt in enumerate(rtts_ms)]
    beats = beats_of(parse_trace("t_s,rtt_ms\n" + "\n".join(lines), name="made"))
    back = beats.arrived_us != NEVER_US
    assert np.all(beats.arrived_us[back] > beats.sent_us[back])
    assert np.all(np.diff(beats.arrived_us[back]) >= 0)
