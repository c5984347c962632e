"""How long messages waited for us: read from stamps, without comparing the clocks of two hosts."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_offload_core.data.process import DataPlan, InputPlan
from robot_offload_core.data.robot import RobotDataProcess
from robot_offload_core.fence import envelope
from robot_offload_core.topics.waits import ON_THE_WAY_S, WAITS_WINDOW_S, Waits
from robot_offload_core.words.messages import Heard
from tests.unit.core.data.test_states import Ports

SYSTEM_S = 1.7e9
"""The system clock at steady time 0."""
SHORTEST_S = 0.0005


def way(waits: Waits, now_s: float, waited_s: float = 0.0, *, ahead_s: float = 0.0, set_s: float = 0.0) -> float:
    """A message comes, from a host whose clock is ahead of ours by so much; ours was set by so much."""
    system_s = SYSTEM_S + set_s + now_s
    return waits.waited_s(system_s - SHORTEST_S - waited_s + ahead_s, system_s, now_s)


@given(st.floats(-3600.0, 3600.0))
def test_a_wait_is_known_whatever_the_publishers_clock_says(ahead_s: float) -> None:
    waits = Waits()
    assert way(waits, 1.0, ahead_s=ahead_s) == 0.0, "nothing to compare the first one with"
    assert way(waits, 1.1, 0.110, ahead_s=ahead_s) == pytest.approx(0.110, abs=1e-5)
    assert way(waits, 1.12, 0.0, ahead_s=ahead_s) == pytest.approx(0.0, abs=1e-5)


def test_the_shortest_way_is_remembered_for_a_window_at_least_and_two_at_most() -> None:
    waits = Waits()
    way(waits, 0.0)
    times_s = [step * 0.1 for step in range(1, int(3 * WAITS_WINDOW_S / 0.1))]
    known = {now_s: way(waits, now_s, 0.050) for now_s in times_s}
    assert all(each == pytest.approx(0.050, abs=1e-5) for now_s, each in known.items() if now_s < WAITS_WINDOW_S)
    assert all(each < 1e-5 for now_s, each in known.items() if now_s > 2 * WAITS_WINDOW_S + 0.2), (
        "the way has become longer"
    )


def test_after_a_long_silence_nothing_is_known() -> None:
    waits = Waits()
    way(waits, 0.0)
    assert way(waits, 2 * WAITS_WINDOW_S + 1.0, 0.3) == 0.0


def test_a_message_that_was_on_its_way_when_our_clock_was_set_back_teaches_nothing() -> None:
    waits = Waits()
    way(waits, 0.0)
    on_its_way = SYSTEM_S + 0.0995
    assert waits.waited_s(on_its_way, SYSTEM_S - 0.4 + 0.1, 0.1) == 0.0
    later_s = 0.1 + ON_THE_WAY_S + 0.1
    assert way(waits, later_s, set_s=-0.4) == pytest.approx(0.0, abs=1e-5)
    assert way(waits, later_s + 0.1, 0.1, set_s=-0.4) == pytest.approx(0.1, abs=1e-5)


def test_our_clock_set_forward_makes_what_was_on_its_way_old_and_nothing_else() -> None:
    """A virtual machine that stood still looks like that too, and then it is old."""
    waits = Waits()
    way(waits, 0.0)
    assert waits.waited_s(SYSTEM_S + 0.0995, SYSTEM_S + 0.4 + 0.1, 0.1) == pytest.approx(0.4, abs=1e-3)
    assert way(waits, 0.2, set_s=0.4) == pytest.approx(0.0, abs=1e-5)


def test_an_envelope_refers_to_a_beat_as_much_older_as_its_message_waited() -> None:
    heard = Heard("1" * 32, 5_000_000, 3.0)
    assert heard.echo_us(0.0) == 5_000_000
    assert heard.echo_us(0.11) == 4_890_000
    assert heard.echo_us(10.0) == 1, "0 would mean that nobody was heard"


def test_a_stamp_of_the_future_makes_the_others_late_for_two_windows_at_most() -> None:
    """Who publishes that is in front of the consumer anyway; what is refused costs the cloud its charge, no more."""
    waits = Waits()
    way(waits, 0.0)
    way(waits, 0.1, ahead_s=1000.0)
    assert way(waits, 0.2) == pytest.approx(1000.0, abs=1.0)
    times_s = [step * 0.1 for step in range(3, int(2 * WAITS_WINDOW_S / 0.1) + 5)]
    assert [way(waits, now_s) for now_s in times_s][-1] == pytest.approx(0.0, abs=1e-5)


def test_an_input_that_waited_for_us_refers_to_an_older_beat_and_a_latched_one_never() -> None:
    ports = Ports()
    process = RobotDataProcess(DataPlan((InputPlan("scan", 300), InputPlan("map", latched=True)), ()), ports)
    process.handle(Heard("1" * 32, 99_000_000, 100.0))
    for name in ("scan", "map"):
        process.forward(name, b"first", published_s=ports.system_s() - 0.001)
        process.forward(name, b"second", published_s=ports.system_s() - 0.101)
    echoes_us = [(channel, envelope.decode(header).echo_us) for channel, header, _ in ports.crossed]
    assert echoes_us[0] == ("in/scan", 99_000_000)
    assert echoes_us[1][1] == pytest.approx(98_900_000, abs=10)
    assert [echo_us for channel, echo_us in echoes_us if channel == "in/map"] == [99_000_000, 99_000_000]
