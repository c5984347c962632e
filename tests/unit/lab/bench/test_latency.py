import pytest

from robot_offload_lab.bench.analysis import latency
from robot_offload_lab.bench.analysis.latency import LatencyAccount
from robot_offload_lab.bench.groups.latency import CASE, SIZES
from robot_offload_lab.bench.observed import Hop, size_of
from robot_offload_lab.bench.parts.hop import datagrams
from robot_offload_lab.judge.recording import Arrival


def arrival(sequence: int, ms: float, site: str = "cloud") -> Arrival:
    return Arrival("/t", 100.0 + ms / 1e3, "p", sequence, 100.0, site)  # type: ignore[arg-type]


def account(commands: list[Arrival]) -> LatencyAccount:
    hops = tuple(Hop(100.0, size, 10.2) for size in SIZES)
    direct = tuple(arrival(number, 0.5) for number in range(9))
    return LatencyAccount(tuple(commands), tuple(arrival(number, 12.2) for number in range(9)), direct, hops)


def test_sizes_take_turns_by_sequence():
    assert [size_of(number, SIZES) for number in (1, 2, 3, 4)] == [1024, 16384, 64, 1024]


def test_the_links_own_delay_is_taken_off_and_direct_dds_stands_beside():
    found = latency.outcome(CASE, "realtime", account([arrival(number, 13.2) for number in range(9)]))
    figures = {figure.name: figure for figure in found.figures}
    assert figures["command_64_p50"].value == pytest.approx(3.0)
    assert figures["input_16384_p99"].value == pytest.approx(2.0)
    assert figures["command_64_p50"].note == "direct DDS beside it: 0.50 ms"
    assert (figures["command_64_p99"].must, figures["command_64_p99"].aim) == (12.0, 6.0)


def test_commands_of_the_robot_are_no_carried_ones():
    found = latency.outcome(CASE, "normal", account([arrival(0, 13.2), arrival(3, 0.5, site="robot")]))
    assert next(f for f in found.figures if f.name == "command_64_p50").count == 1


def test_without_a_measured_link_nothing_is_claimed():
    empty = LatencyAccount((arrival(0, 13.2),), (), (), ())
    assert {figure.value for figure in latency.outcome(CASE, "realtime", empty).figures} == {None}


@pytest.mark.parametrize(("size", "count"), [(64, 1), (1000, 1), (1024, 2), (16384, 15)])
def test_a_message_takes_as_many_datagrams_as_it_needs(size: int, count: int):
    assert datagrams(size) == count


def test_sizes_are_told_as_people_write_them():
    assert [latency.text(size) for size in SIZES] == ["64 B", "1 KiB", "16 KiB"]
