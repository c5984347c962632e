import pytest

from robot_offload_lab.bench.analysis import collector
from robot_offload_lab.bench.analysis.collector import Load, Passed
from robot_offload_lab.bench.groups.collector import LARGE_LOADS, LOADS, offload
from robot_offload_lab.bench.parts import burst


def figures(*found: Passed):
    return {figure.name: figure for figure in collector.outcome("realtime", found).figures}


def test_the_way_through_the_collector_is_compared_with_the_direct_one():
    found = figures(Passed(Load(64, 50.0), 2, 1.0, (0.6, 0.6), (0.2, 0.2)))
    assert found["64_50_default_p50"].value == pytest.approx(0.6)
    assert found["64_50_default_p50"].ratio == pytest.approx(3.0)
    assert found["64_50_default_p50"].note == "added 0.40 ms"


def test_what_was_delivered_is_told_in_percent_and_throughput():
    found = figures(Passed(Load(1 << 20, 10.0), 10, 2.0, (5.0,) * 8, (2.0,) * 10))
    assert found["1048576_10_default_delivered"].value == pytest.approx(80.0)
    assert found["1048576_10_default_delivered"].ratio == pytest.approx(0.8)
    assert found["1048576_10_default_delivered"].note == "4.00 MiB/s"


def test_a_load_of_which_nothing_came_has_no_latency():
    found = figures(Passed(Load(64, 50.0), 2, 1.0, (), (0.2,)))
    assert found["64_50_default_p50"].value is None
    assert found["64_50_default_delivered"].value == 0


def test_the_loads_reach_from_64_bytes_to_a_mebibyte_and_have_names_of_their_own():
    loads = (*LOADS, *LARGE_LOADS)
    assert (min(load.size for load in loads), max(load.size for load in loads)) == (64, 1 << 20)
    assert len({load.name for load in loads}) == len(loads)


def test_the_node_is_held_on_the_robot():
    assert offload().spec.switching.pin == "Robot"


def test_a_message_carries_its_mark_in_front_of_its_data():
    data = burst.mark(burst.message(64), 3, 7)
    assert len(data) == burst.HEAD.size + 64
    _, stage, number = burst.MARK.unpack_from(data, burst.HEAD.size)
    assert (stage, number) == (3, 7)
    assert burst.HEAD.unpack_from(data)[3] == 64
