import importlib

import pytest

from robot_offload_lab.bench import kinds
from robot_offload_lab.bench.analysis import experiment
from robot_offload_lab.bench.analysis.experiment import ExperimentScenario, Travelled
from robot_offload_lab.bench.groups.experiment import EVER
from robot_offload_lab.bench.kinds import KINDS
from robot_offload_lab.judge.measures import Interval
from robot_offload_lab.judge.recording import Arrival
from robot_offload_lab.wire.dds_options import carried

WINDOW = Interval(10.0, 20.0)


def arrival(number: int, sent_s: float, took_ms: float, passed_ms: float = 0.1) -> Arrival:
    passed_s = sent_s + passed_ms / 1e3
    return Arrival("/bench/out/imu", sent_s + took_ms / 1e3, "imu", number, sent_s, "robot", passed_s)


def travelled(
    scenario: ExperimentScenario, values: tuple[float, ...], own_ms: float | None = None, lost: int = 0
) -> Travelled:
    return Travelled(scenario, {"imu": values}, lost, own_ms, 30.0, 20.0, 5.0)


def test_a_latency_ends_when_the_consumer_has_the_message_not_when_it_was_passed_on():
    [took_ms] = experiment.latencies([arrival(1, 11.0, 4.0, passed_ms=1.0)], WINDOW, EVER, halved=False)
    assert took_ms == pytest.approx(4.0)


def test_across_hosts_a_latency_is_half_a_round_trip():
    [took_ms] = experiment.latencies([arrival(1, 11.0, 24.0)], WINDOW, EVER, halved=True)
    assert took_ms == pytest.approx(12.0)


def test_only_messages_made_in_the_window_count():
    found = experiment.latencies([arrival(1, 9.9, 1.0), arrival(2, 20.1, 1.0)], WINDOW, EVER, halved=False)
    assert found == []


def test_messages_that_the_robots_own_replica_sent_back_do_not_count():
    cloud = [Interval(0.0, 12.0)]
    found = experiment.latencies([arrival(1, 11.0, 20.0), arrival(2, 13.0, 1.0)], WINDOW, cloud, halved=True)
    assert found == [pytest.approx(10.0)]


def test_missing_numbers_are_lost_messages():
    assert experiment.lost([arrival(n, 10.0 + n, 1.0) for n in (1, 2, 5)], WINDOW) == 2
    assert experiment.lost([], WINDOW) == 0


def test_what_is_added_is_over_the_links_own_delay_and_held_against_the_limits():
    direct = ExperimentScenario("direct", "direct DDS", "10ms each way", True)
    ours = ExperimentScenario("ours", "Zenoh", "10ms each way", True, "direct", demanded=True)
    found = [travelled(direct, (10.5,), 10.0), travelled(ours, (11.5,), 10.0)]
    figures = {figure.name: figure for figure in experiment.outcome("realtime", found, {}).figures}
    assert figures["ours_added_p50"].value == pytest.approx(1.5)
    assert (figures["ours_added_p50"].must, figures["ours_added_p99"].must) == (4.0, 12.0)
    assert (figures["ours_added_p50"].aim, figures["ours_added_p99"].aim) == (2.5, 6.0)
    assert figures["ours_added_p50"].note == "direct DDS adds 0.50 ms"
    assert figures["direct_added_p50"].must is None
    assert figures["ours_p50"].ratio == pytest.approx(11.5 / 10.5)


def test_processor_time_and_lost_messages_stand_beside_every_scenario():
    one = ExperimentScenario("one", "one host", "one host", False)
    figures = {f.name: f for f in experiment.outcome("realtime", [travelled(one, (1.0,), lost=3)], {}).figures}
    assert figures["one_lost"].value == 3
    assert figures["one_cpu"].value == 20.0
    assert "whole machine 30 %" in figures["one_cpu"].note
    assert "agent 5.0" in figures["one_cpu"].note


def test_there_are_ten_kinds_of_messages_each_with_a_header():
    assert len({kind.type for kind in KINDS}) == len({kind.name for kind in KINDS}) == 10
    for kind in KINDS:
        package, _, short = kind.type.partition("/msg/")
        assert hasattr(getattr(importlib.import_module(f"{package}.msg"), short)(), "header")
        assert package in ("sensor_msgs", "geometry_msgs")


@pytest.mark.parametrize("transport", ["Zenoh", "StaticPeers"])
def test_the_resource_carries_every_kind_to_the_cloud_and_collects_what_comes_back(transport: str):
    spec = kinds.offload(transport, 20.0).spec
    assert {topic.name for topic in spec.topics.to_cloud} == {kind.sent for kind in KINDS}
    assert {output.topic for _, output in spec.collected_outputs} == {kind.returned for kind in KINDS}
    assert {one.topic for one in carried(spec)} >= {kind.sent for kind in KINDS}
