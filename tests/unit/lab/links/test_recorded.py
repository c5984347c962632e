"""Traces: both formats, what they mean at each moment, and errors that name file and line."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_offload.errors import InputError
from robot_offload_lab.links.recorded import Trace, TraceError, load_trace, parse_trace

EXAMPLES = Path(__file__).parents[4] / "examples" / "traces"


def text(*rtts_ms: float) -> Trace:
    return parse_trace("\n".join(f"{rtt:g}" for rtt in rtts_ms), name="made")


def test_the_lines_of_the_text_format_sum_up_to_the_elapsed_time() -> None:
    trace = parse_trace("# a comment\n10\n\n20.5\n30\n", name="made")
    assert trace.rtts_ms == (10, 20.5, 30)
    assert trace.times_s == pytest.approx((0, 0.010, 0.0305))
    assert trace.duration_s == pytest.approx(0.0605)
    assert trace.median_ms == 20.5


def test_the_csv_format_tells_times_and_losses() -> None:
    trace = parse_trace("# ours\nt_s,rtt_ms\n5.0,10\n5.1,\n5.2,30\n", name="made")
    assert trace.times_s == pytest.approx((0, 0.1, 0.2)), "the first request is the origin"
    assert trace.rtts_ms == (10, None, 30)
    assert trace.duration_s == pytest.approx(0.3)
    assert trace.median_ms == 20


def test_half_of_the_round_trip_counts_in_each_direction() -> None:
    trace = text(10, 20, 30)
    assert trace.one_way_ms(0.0) == 5
    assert trace.one_way_ms(0.009) == 5
    assert trace.one_way_ms(0.011) == 10
    assert trace.one_way_ms(0.059) == 15


def test_a_packet_sent_during_a_stall_arrives_at_its_end() -> None:
    trace = text(10, 10, 500, 10)
    assert trace.stall_ms == 40
    assert trace.one_way_ms(0.020) == pytest.approx(500)
    assert trace.one_way_ms(0.400) == pytest.approx(120)
    assert trace.one_way_ms(0.525) == 5


def test_the_stall_limit_is_three_medians_on_a_slow_link() -> None:
    trace = text(100, 110, 100, 250, 100)
    assert trace.stall_ms == 300
    assert trace.one_way_ms(0.4) == 125, "250 ms is long but no stall on this link"


def test_a_stall_holds_what_later_requests_of_a_csv_trace_send_too() -> None:
    trace = parse_trace("t_s,rtt_ms\n0,10\n1.0,250\n1.1,150\n1.2,50\n1.3,10\n2,10\n3,10\n", name="made")
    assert trace.one_way_ms(1.05) == pytest.approx(200)
    assert trace.one_way_ms(1.15) == pytest.approx(100)
    assert trace.one_way_ms(1.22) == pytest.approx(30)
    assert trace.one_way_ms(1.26) == 5, "between a stall and the next request: half of the median"
    assert trace.one_way_ms(1.31) == 5


def test_a_lost_request_means_no_link_until_the_next_one() -> None:
    trace = parse_trace("t_s,rtt_ms\n0,10\n1,\n2,10\n", name="made")
    assert trace.one_way_ms(0.99) == 5
    assert trace.one_way_ms(1.0) is None
    assert trace.one_way_ms(1.99) is None
    assert trace.one_way_ms(2.0) == 5


def test_a_trace_begins_again_when_it_ends() -> None:
    trace = text(10, 20, 30)
    assert trace.one_way_ms(trace.duration_s * 5 + 0.011) == 10


@given(st.lists(st.floats(min_value=0.1, max_value=2000), min_size=1, max_size=60), st.integers(0, 3000))
def test_no_packet_of_a_trace_overtakes_an_earlier_stall(rtts_ms: list[float], start_ms: int) -> None:
    trace = text(*rtts_ms)
    released_s = 0.0
    for t_s in (start_ms / 1000 + step / 200 for step in range(100)):
        if t_s >= trace.duration_s:
            break
        delay_ms = trace.one_way_ms(t_s)
        assert delay_ms is not None
        assert delay_ms > 0
        assert t_s + delay_ms / 1000 >= released_s - 1e-9
        index = max(i for i, at_s in enumerate(trace.times_s) if at_s <= t_s)
        rtt_ms = trace.rtts_ms[index]
        if rtt_ms is not None and rtt_ms > trace.stall_ms:
            released_s = trace.times_s[index] + rtt_ms / 1000


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "lost.txt:1: the trace is empty"),
        ("# only\n# comments\n", "lost.txt:1: the trace is empty"),
        ("10\nten\n", "lost.txt:2: the round-trip time in ms must be a number, found 'ten'"),
        ("10\n\n-3\n", "lost.txt:3: a round-trip time must be above 0 ms"),
        ("10\nnan\n", "lost.txt:2: the round-trip time in ms must be finite"),
        ("1,2\n", "lost.txt:1: a trace with commas must begin with the line 't_s,rtt_ms'"),
        ("t_s,rtt_ms\n0,10\n0,10\n", "lost.txt:3: t_s must grow from line to line, but 0 follows 0"),
        ("t_s,rtt_ms\n0,10,3\n", "lost.txt:2: expected two values"),
        ("t_s,rtt_ms\n0,\n1,\n", "lost.txt:1: no line after the header has a round-trip time"),
        ("t_s,rtt_ms\n", "lost.txt:1: no line after the header has a round-trip time"),
        ("t_s,rtt_ms\nsoon,10\n", "lost.txt:2: t_s must be a number, found 'soon'"),
    ],
)
def test_a_broken_trace_is_refused_with_file_and_line(tmp_path: Path, content: str, message: str) -> None:
    path = tmp_path / "lost.txt"
    path.write_text(content)
    with pytest.raises(TraceError) as caught:
        load_trace(path)
    assert message in str(caught.value)
    assert str(caught.value).startswith(str(tmp_path))
    assert isinstance(caught.value, InputError)


def test_a_missing_or_binary_trace_is_refused_with_its_name(tmp_path: Path) -> None:
    with pytest.raises(TraceError, match=r"nowhere\.txt: cannot read the trace: No such file"):
        load_trace(tmp_path / "nowhere.txt")
    (tmp_path / "picture.txt").write_bytes(b"\xff\xfe\x00\x80")
    with pytest.raises(TraceError, match=r"picture\.txt: cannot read the trace: it is not text"):
        load_trace(tmp_path / "picture.txt")


@given(st.text(max_size=200))
def test_no_text_whatever_raises_anything_but_a_trace_error(content: str) -> None:
    try:
        trace = parse_trace(content, name="made")
    except TraceError:
        return
    assert trace.duration_s > 0
    trace.one_way_ms(0.0)


def test_the_examples_hold_stalls_and_losses() -> None:
    wifi = load_trace(EXAMPLES / "corridor-wifi.txt")
    assert 8 < wifi.median_ms < 16
    assert sum(rtt is not None and rtt > 150 for rtt in wifi.rtts_ms) >= 2
    assert wifi.duration_s == pytest.approx(60, abs=1)
    mobile = load_trace(EXAMPLES / "yard-4g.csv")
    assert 45 < mobile.median_ms < 70
    assert sum(rtt is None for rtt in mobile.rtts_ms) > 20
    assert mobile.duration_s == pytest.approx(180)
