"""What the emulated link is like when, and how its options are written."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_offload.errors import InputError
from robot_offload_lab.links.recorded import parse_trace
from robot_offload_lab.wire import options as wire_config
from robot_offload_lab.wire.model import CLEAR, LinkConditions, WireError
from robot_offload_lab.wire.options import Address, Forward, LinkOptions, OptionError, WireConfig
from robot_offload_lab.wire.schedule import (
    BOTH_CLEAR,
    BOTH_CUT,
    Constant,
    Periodic,
    Replay,
    Schedule,
    ScheduleError,
    outage,
    slow_phase,
)


def constant(delay_ms: float) -> Constant:
    here = LinkConditions(delay_ms=delay_ms)
    return Constant(here, here)


def test_an_outage_ends_each_period() -> None:
    part = outage(4, 20)
    for cycle in range(5):
        start_s = cycle * 20.0
        assert part.at(start_s) == BOTH_CLEAR
        assert part.at(start_s + 15.99) == BOTH_CLEAR
        assert part.at(start_s + 16.0) == BOTH_CUT
        assert part.at(start_s + 19.99) == BOTH_CUT


def test_a_slow_phase_adds_half_of_its_round_trip_each_way() -> None:
    schedule = Schedule((constant(10), slow_phase(3, 45, 120)))
    assert schedule.latency_ms(41) == 20
    assert schedule.latency_ms(43) == 140
    up, down = schedule.at(43)
    assert (up.delay_ms, down.delay_ms) == (70, 70)


@pytest.mark.parametrize("phase", [(0, 20), (20, 20), (21, 20), (1, float("inf"))])
def test_an_impossible_phase_is_refused(phase: tuple[float, float]) -> None:
    with pytest.raises(ScheduleError, match="must last longer than 0 s and shorter than its period"):
        outage(*phase)


@given(st.floats(0.01, 100), st.floats(0.01, 0.99), st.floats(0, 10_000))
def test_the_next_change_is_where_the_conditions_change(period_s: float, share: float, t_s: float) -> None:
    part = Periodic(period_s * share, period_s, *BOTH_CUT)
    change_s = part.next_change_s(t_s)
    assert change_s is not None
    assert change_s >= t_s
    assert change_s - t_s <= period_s * 1.000001
    step_s = min(share, 1 - share) * period_s / 1000
    if change_s - t_s > 2 * step_s:
        assert part.at(t_s) == part.at(change_s - step_s)
        assert part.at(t_s) != part.at(change_s + step_s)


def test_the_changes_of_a_schedule_are_those_of_all_its_parts() -> None:
    schedule = Schedule((constant(10), outage(4, 20), slow_phase(3, 45, 120)))
    changes_s, t_s = [], 0.0
    while (change_s := schedule.next_change_s(t_s)) is not None and change_s < 61:
        changes_s.append(change_s)
        t_s = change_s + 0.001
    assert changes_s == pytest.approx([16, 20, 36, 40, 42, 45, 56, 60])
    assert Schedule((constant(10),)).next_change_s(0) is None


def test_schedules_compose() -> None:
    both = Schedule((constant(10),)) + Schedule((outage(4, 20), slow_phase(3, 45, 60)))
    assert both.at(5)[0] == LinkConditions(delay_ms=10)
    assert both.at(43)[1].delay_ms == 40
    assert both.at(17)[0] == LinkConditions(delay_ms=10, cut=True)
    nested = Schedule((both, constant(1)))
    assert nested.at(43)[1].delay_ms == 41
    assert Schedule().at(3) == BOTH_CLEAR


def test_directions_may_differ() -> None:
    schedule = Schedule((Constant(LinkConditions(delay_ms=10), LinkConditions(delay_ms=30)),))
    assert schedule.latency_ms(0) == 40


def test_before_the_start_the_link_is_as_it_usually_is() -> None:
    trace = parse_trace("t_s,rtt_ms\n0,\n1,10\n2,20\n3,900\n", name="made")
    schedule = Schedule((constant(5), outage(4, 20), slow_phase(3, 45, 60), Replay(trace)))
    up, down = schedule.quiet()
    assert (up, down) == (LinkConditions(delay_ms=15), LinkConditions(delay_ms=15))


def test_the_answer_meets_the_conditions_of_its_own_time() -> None:
    schedule = Schedule((constant(50), outage(4, 20)))
    assert schedule.latency_ms(15.9) == 100
    assert schedule.latency_ms(15.96) is None, "the packet passes, its answer meets the cut"
    assert schedule.latency_ms(16.5) is None
    assert schedule.latency_ms(20.0) == 100


def test_a_loss_of_everything_counts_as_a_cut() -> None:
    assert Schedule((Constant(LinkConditions(loss=1), CLEAR),)).latency_ms(0) is None


def test_a_replayed_stall_holds_the_packet_and_then_its_answer_is_quick() -> None:
    schedule = Schedule((Replay(parse_trace("10\n10\n500\n10\n10\n", name="made")),))
    assert schedule.latency_ms(0.0) == pytest.approx(10)
    assert schedule.latency_ms(0.12) == pytest.approx(400 + 5)
    assert schedule.latency_ms(0.018) == pytest.approx(5 + 497), "the answer is held by the stall that begins"


def test_a_lost_request_of_a_trace_cuts_both_directions() -> None:
    schedule = Schedule((Replay(parse_trace("t_s,rtt_ms\n0,10\n1,\n2,10\n", name="made")), constant(3)))
    assert schedule.at(1.5)[0].cut
    assert schedule.at(1.5)[1].cut
    assert schedule.latency_ms(0.5) == 16


def test_good_intervals_leave_out_outages_and_slow_phases() -> None:
    schedule = Schedule((constant(10), outage(4, 20), slow_phase(3, 30, 120)))
    good = schedule.good_intervals(threshold_ms=60, duration_s=60)
    # The round trip begins to miss the outage one delay before it, as its answer would be cut.
    wanted = [(0, 15.99), (20, 26.99), (30, 35.99), (40, 55.99)]
    assert [pytest.approx(pair, abs=1e-3) for pair in wanted] == list(good)


def test_good_intervals_without_any_event_are_all_or_nothing() -> None:
    assert Schedule((constant(10),)).good_intervals(60, 30) == ((0.0, 30),)
    assert Schedule((constant(40),)).good_intervals(60, 30) == ()
    ((begin_s, end_s),) = Schedule((outage(4, 20),)).good_intervals(60, 17)
    assert begin_s == 0
    assert end_s == pytest.approx(16, abs=1e-3)


@given(
    st.lists(st.sampled_from([outage(4, 20), outage(0.5, 3), slow_phase(3, 45, 120), constant(9)]), max_size=4),
    st.floats(5, 80),
)
def test_the_latency_is_good_inside_and_bad_between_good_intervals(parts: list[Any], threshold_ms: float) -> None:
    schedule = Schedule(tuple(parts))
    good = schedule.good_intervals(threshold_ms, 50, step_s=0.02)
    for begin_s, end_s in good:
        middle_ms = schedule.latency_ms((begin_s + end_s) / 2)
        assert middle_ms is not None
        assert middle_ms <= threshold_ms
    for (_, end_s), (begin_s, _) in itertools.pairwise(good):
        middle_ms = schedule.latency_ms((end_s + begin_s) / 2)
        assert middle_ms is None or middle_ms > threshold_ms


# Options


@pytest.mark.parametrize(
    ("parse", "text", "value"),
    [
        (wire_config.parse_ms, "10ms", 10),
        (wire_config.parse_ms, "0.5 s", 500),
        (wire_config.parse_loss, "3%", 0.03),
        (wire_config.parse_loss, "0.03", 0.03),
        (wire_config.parse_rate, "20mbit", 20_000),
        (wire_config.parse_rate, "512 kbit/s", 512),
        (wire_config.parse_rate, "1Gbit/s", 1_000_000),
        (wire_config.parse_outage, "4/20", outage(4, 20)),
        (wire_config.parse_outage, "0.5s / 3s", outage(0.5, 3)),
        (wire_config.parse_slow, "3/45@120ms", slow_phase(3, 45, 120)),
    ],
)
def test_options_are_understood(parse: Callable[[str, str], Any], text: str, value: Any) -> None:
    assert parse("--option", text) == value


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"delay": "10"}, "--delay: '10' is not a valid time; write a number with its unit, for example 10ms or 0.5s"),
        ({"delay": "10ms/"}, "--delay: '' is not a valid time"),
        ({"jitter": "-3ms"}, "--jitter: '-3ms' is not a valid time"),
        ({"loss": "3"}, "--loss: '3' is not a valid share of packets; write for example 3% or 0.03"),
        ({"loss": "101%"}, "--loss: '101%' is not a valid share"),
        ({"rate": "fast"}, "--rate: 'fast' is not a valid rate; write for example 20mbit or 512kbit"),
        ({"rate": "0mbit"}, "--rate: '0mbit' is not a valid rate"),
        ({"queue": "100ms"}, "--queue: there is no queue without a limited rate; add for example --rate 20mbit"),
        ({"outages": ("4",)}, r"--outage: '4' is not a valid phase; write for example 4/20 \(4 s out of every 20 s\)"),
        ({"outages": ("20/4",)}, "--outage: '20/4': a phase must be longer than 0 s and shorter than its period"),
        ({"slow": ("3/45",)}, "--slow: '3/45' does not say how much slower; write for example 3/45@120ms"),
        ({"slow": ("3/45@fast",)}, "--slow: 'fast' is not a valid time"),
        ({"trace": "/nowhere.txt"}, "--trace: /nowhere.txt: cannot read the trace"),
    ],
)
def test_a_wrong_option_is_named_with_the_right_form(options: dict[str, Any], message: str) -> None:
    with pytest.raises(OptionError, match=message) as caught:
        LinkOptions(**options).schedule()
    assert isinstance(caught.value, InputError)
    assert isinstance(caught.value, ValueError)


@given(st.text(max_size=12), st.sampled_from(["delay", "jitter", "loss", "rate", "outages", "slow"]))
def test_no_option_text_raises_anything_but_an_option_error(text: str, name: str) -> None:
    value = (text,) if name in ("outages", "slow") else text
    message = ""
    try:
        LinkOptions(**{name: value}).schedule()  # type: ignore[arg-type]
    except OptionError as error:
        message = str(error)
    assert not message or message.startswith("--")


def test_all_options_together_make_one_schedule(tmp_path: Path) -> None:
    (tmp_path / "trace.txt").write_text("20\n20\n")
    options = LinkOptions(
        delay="10ms/30ms",
        jitter="1ms",
        loss="1%/2%",
        rate="20mbit/s",
        outages=("4/20",),
        slow=("3/45@120ms",),
        trace=str(tmp_path / "trace.txt"),
    )
    up, down = options.schedule().at(0)
    assert (up.delay_ms, down.delay_ms) == (20, 40)
    assert [up.loss, down.loss] == pytest.approx([0.01, 0.02])
    assert up.rate_kbit_s == down.rate_kbit_s == 20_000
    assert up.queue_ms == wire_config.DEFAULT_QUEUE_MS
    assert options.schedule().at(17)[0].cut


def test_rates_and_queues_may_differ_per_direction() -> None:
    up, down = LinkOptions(rate="5mbit/20mbit/s", queue="50ms/100ms").schedule().at(0)
    assert (up.rate_kbit_s, down.rate_kbit_s) == (5000, 20_000)
    assert (up.queue_ms, down.queue_ms) == (50, 100)


# The configuration file

CONFIG = WireConfig(
    forwards=(
        Forward("pulse", "udp", "127.0.0.1:7447", "127.0.0.1:17447"),
        Forward("pulse-tls", "tcp", "127.0.0.1:7447", "127.0.0.1:17447"),
    ),
    link=LinkOptions(delay="10ms", outages=("4/20", "1/7"), slow=("3/45@120ms",)),
    seed=7,
    realtime=True,
)


def test_a_configuration_survives_its_file() -> None:
    assert WireConfig.from_json(CONFIG.to_json()) == CONFIG


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"forwards"', '"forward"', "unknown key 'forward'; known are control, forwards, link"),
        ('"seed": 7', '"seed": "7"', "'seed' must be of type int, found '7'"),
        ('"udp"', '"sctp"', "forward 'pulse': protocol must be udp or tcp, found 'sctp'"),
        ('"127.0.0.1:7447"', '"7447"', "'7447' is not a valid address; write for example 127.0.0.1:7447"),
        ('"127.0.0.1:7447"', '"127.0.0.1:77777"', "is not a valid address"),
        ('"pulse-tls"', '"pulse"', "each with a name of its own"),
        ('"target"', '"to"', "a forward: unknown key 'to'"),
        ('"delay"', '"lag"', "link: unknown key 'lag'"),
        ('"10ms"', "10", "link: 'delay' must be of type str, found 10"),
        ("{", "", "the wire's configuration is not JSON"),
    ],
)
def test_a_broken_configuration_is_refused(old: str, new: str, message: str) -> None:
    good = CONFIG.to_json()
    assert old in good
    with pytest.raises(WireError, match=message):
        WireConfig.from_json(good.replace(old, new, 1))


def test_addresses_with_ipv6_hosts_are_understood() -> None:
    assert Address.parse("[::1]:7447") == Address("::1", 7447)
    assert str(Address("::1", 7447)) == "[::1]:7447"
    assert str(Address.parse("127.0.0.1:0")) == "127.0.0.1:0"


def test_a_configuration_without_any_port_is_refused() -> None:
    with pytest.raises(WireError, match="at least one forward"):
        dataclasses.replace(CONFIG, forwards=())
