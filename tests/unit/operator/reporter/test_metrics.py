"""The agent's state as Prometheus metrics."""

from __future__ import annotations

from pathlib import Path

from prometheus_client.parser import text_string_to_metric_families

from robot_offload.api.agent_state import Sight
from robot_offload.reporter.metrics import Counts, exposition
from tests.unit.operator.reporter.states import seen


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
        "robot_offload_topic_bytes_total,/scan": 123456.0,
        "robot_offload_state_age_at_change_seconds,controller_1": 0.085,
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
    assert found['robot_offload_node_state,a"b\n,x\\y'] == 1.0


def test_the_page_for_people_names_every_metric() -> None:
    page = (Path(__file__).parents[4] / "docs" / "reference" / "reporter.md").read_text()
    names = {name.partition(",")[0] for name in samples(seen(100.0))}
    assert not [name for name in names if f"`{name}" not in page]
