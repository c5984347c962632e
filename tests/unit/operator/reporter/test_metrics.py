"""The agent's state as Prometheus metrics."""

from __future__ import annotations

import re

import pytest
from prometheus_client.parser import text_string_to_metric_families

from robot_offload.api.agent_state import Sight
from robot_offload.reporter.families import FAMILIES
from robot_offload.reporter.metrics import Counts, exposition
from tests.unit.operator.reporter.states import REPORT, seen


def samples(sight: Sight, counts: Counts | None = None, now_s: float = 101.0) -> dict[str, float]:
    page = exposition(sight, counts or Counts(), now_s).decode()
    return {
        sample.name + "".join(f",{value}" for _, value in sorted(sample.labels.items())): sample.value
        for family in text_string_to_metric_families(page)
        for sample in family.samples
    }


def test_a_living_agent_is_told_whole() -> None:
    found = samples(seen(100.0), Counts(lease_writes=7, lease_failures=2, handovers=1))
    assert found == {
        "robot_offload_agent_alive": 1.0,
        "robot_offload_agent_state_age_seconds": 1.0,
        "robot_offload_robot_connected": 1.0,
        "robot_offload_agent_ready": 1.0,
        "robot_offload_epoch": 12.0,
        "robot_offload_placement,robot": 0.0,
        "robot_offload_placement,cloud": 1.0,
        "robot_offload_placement,unknown": 0.0,
        "robot_offload_round_trip_seconds,0.5": 0.0115,
        "robot_offload_round_trip_seconds,0.99": 0.019,
        "robot_offload_topic_bytes_total,to_cloud,cloud,/scan": 123456.0,
        "robot_offload_topic_messages_total,to_cloud,cloud,/scan": 400.0,
        "robot_offload_state_age_at_change_seconds,cloud,controller_1": 0.085,
        "robot_offload_robot_report": 0.0,
        "robot_offload_node_state,controller,active": 1.0,
        "robot_offload_agent_generation": 3.0,
        "robot_offload_robot_generation": 3.0,
        "robot_offload_settings_accepted": 1.0,
        "robot_offload_lease_writes_total": 7.0,
        "robot_offload_lease_failures_total": 2.0,
        "robot_offload_handovers_total": 1.0,
        "robot_offload_streams_refused_total": 0.0,
        "robot_offload_streams_dropped_total": 0.0,
    }


def test_a_silent_agent_leaves_a_gap_instead_of_old_numbers() -> None:
    found = samples(seen(100.0), now_s=160.0)
    assert found["robot_offload_agent_alive"] == 0.0
    assert found["robot_offload_agent_state_age_seconds"] == 60.0
    assert not {name for name in found if name.startswith(("robot_offload_placement", "robot_offload_robot"))}


def test_what_is_not_known_is_not_told() -> None:
    found = samples(seen(100.0, round_trip_ms={"p50": None}, settings={}))
    assert not {name for name in found if "round_trip" in name or "settings" in name or "robot_generation" in name}
    assert samples(Sight())["robot_offload_agent_alive"] == 0.0


def test_names_of_nodes_cannot_break_the_page() -> None:
    found = samples(seen(100.0, nodes=[{"name": 'a"b\n', "state": "x\\y"}]))
    assert found['robot_offload_node_state,a"b ,x\\y'] == 1.0


def test_each_side_says_its_own_numbers() -> None:
    found = samples(seen(100.0, cloud={"beats": [900, 3], "ready": True}, robot=REPORT))
    wanted = {
        "robot_offload_robot_report": 1.0,
        "robot_offload_beats_lost_total,cloud": 3.0,
        "robot_offload_beats_lost_total,robot": 7.0,
        "robot_offload_side_ready,cloud": 1.0,
        "robot_offload_changeovers_total,HeartbeatLost,robot,robot": 2.0,
        "robot_offload_loss_detections_total,robot": 2.0,
        "robot_offload_false_alarms_total,robot": 1.0,
        "robot_offload_nobody_in_charge_seconds_total,robot": 0.19,
        "robot_offload_command_overdue_seconds_total,/cmd_vel,robot": 0.05,
        "robot_offload_command_gap_seconds_count,/cmd_vel,robot": 12.0,
        "robot_offload_command_gap_seconds_bucket,0.05,/cmd_vel,robot": 3.0,
        "robot_offload_command_gap_seconds_sum,/cmd_vel,robot": 1.2,
        "robot_offload_link_latency_seconds_bucket,+Inf,robot": 14.0,
        "robot_offload_input_messages_total,thinned,robot,/scan": 4.0,
        "robot_offload_refused_messages_total,TooOld,robot": 5.0,
        "robot_offload_goals_total,/go,succeeded,robot": 3.0,
        "robot_offload_open_goals,/go,robot,executing": 1.0,
        "robot_offload_open_goals,/go,robot,waiting": 2.0,
        "robot_offload_goal_restarts_total,/go,robot": 4.0,
        "robot_offload_open_calls,/plan,robot": 3.0,
        "robot_offload_open_used,goal,robot": 1.0,
        "robot_offload_process_cpu_seconds_total,control,robot": 1.5,
        "robot_offload_process_resident_memory_bytes,control,robot": 2048.0,
        "robot_offload_link_latency_now_seconds,robot": pytest.approx(0.0118),
        "robot_offload_report_entries_left_out,robot": 2.0,
    }
    assert {name: found.get(name) for name in wanted} == wanted


def test_no_robot_report_leaves_gaps_and_says_so() -> None:
    found = samples(seen(100.0, cloud={"beats": [900, 3]}, robot=None))
    assert found["robot_offload_robot_report"] == 0.0
    assert not [name for name in found if name.endswith(",robot") and "placement" not in name]


def test_two_hundred_topics_stay_within_the_series_that_the_reference_names() -> None:
    topics = [
        {"topic": f"/t{number}", "direction": "to_cloud", "bytes": number, "messages": 1} for number in range(200)
    ]
    wide = {f"/t{number}": [1, 0, 0, 0] for number in range(200)}
    page = exposition(seen(100.0, carried=topics, robot=REPORT | {"topics": wide}), Counts(), 101.0).decode()
    for family in FAMILIES:
        lines = [
            line for line in page.splitlines() if re.match(rf"{family.name}(_total|_bucket|_sum|_count)?[{{ ]", line)
        ]
        assert len(lines) <= 2 * family.series, family.name
    assert page.count("robot_offload_topic_bytes_total{") == 64


def test_a_metric_is_declared_once_and_by_its_convention() -> None:
    assert len({family.name for family in FAMILIES}) == len(FAMILIES)
    for family in FAMILIES:
        assert not family.name.endswith("_total"), family.name
        assert family.text.endswith("."), family.name
