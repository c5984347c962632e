"""The models as the one source of defaults and descriptions."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

import pytest

from robot_offload.api.v1alpha1 import Output, RobotOffload
from robot_offload.api.v1alpha1.parsing import parse_object, parse_text
from tests.unit.specs import MINIMAL, SAMPLE, sample


def test_the_sample_is_read_with_every_field() -> None:
    offload = parse_text(SAMPLE, "sample.yaml")
    controller = offload.spec.nodes[1]
    assert offload.metadata.name == "wheelchair-7"
    assert offload.spec.cloud_domain_id == 43
    assert offload.spec.topics.to_cloud[0].max_age_ms == 300
    assert controller.duplicated
    assert controller.run is not None
    assert controller.run.cloud_parameters == {"rate_hz": 50.0, "max_speed": 0.9}
    assert [output.topic for _, output in offload.spec.collected_outputs] == ["/cmd_vel"]
    assert offload.spec.switching.latency.allowed_loop_ms == 60


def test_a_minimal_specification_gets_the_documented_defaults() -> None:
    spec = parse_text(MINIMAL, "minimal.yaml").spec
    assert spec.robot.domain_id == spec.cloud_domain_id == 0
    assert spec.transport.type == "Zenoh"
    switching = spec.switching
    assert (switching.heartbeat_period_ms, switching.loss_timeout_ms, switching.lease_ms) == (20, 90, 250)
    assert (switching.max_command_age_ms, switching.activation_deadline_ms) == (150, 250)
    assert spec.nodes[0].standby.robot == spec.nodes[0].standby.cloud == "Warm"


def test_a_file_that_is_written_back_reads_the_same() -> None:
    offload = parse_object(sample(), "sample")
    written = offload.model_dump(mode="json", exclude_unset=True)
    assert written == sample()
    assert parse_object(json.loads(json.dumps(written)), "again") == offload


@pytest.mark.parametrize(
    ("output", "expected_ms"),
    [
        ({"topic": "/a"}, 0.0),
        ({"topic": "/a", "rate": 20.0}, 150.0),
        ({"topic": "/a", "rate": 100.0}, 100.0),
        ({"topic": "/a", "rate": 100.0, "deadline": "50ms"}, 50.0),
    ],
)
def test_an_output_is_judged_after_three_periods_but_at_least_100_ms(
    output: dict[str, Any], expected_ms: float
) -> None:
    assert Output.model_validate(output).judged_after_ms == pytest.approx(expected_ms)


def test_models_cannot_be_changed() -> None:
    offload = parse_text(MINIMAL, "minimal.yaml")
    with pytest.raises(ValueError, match="frozen"):
        offload.metadata.name = "other"  # type: ignore[misc]


def fields() -> Iterator[tuple[str, dict[str, Any]]]:
    schema = RobotOffload.model_json_schema(mode="serialization")
    for name, model in {"RobotOffload": schema, **schema["$defs"]}.items():
        for field, described in model["properties"].items():
            # pydantic leaves out a description that only repeats the model's own.
            model_of = described.get("$ref", "").removeprefix("#/$defs/")
            yield f"{name}.{field}", schema["$defs"].get(model_of, {}) | described


@pytest.mark.parametrize(("name", "described"), [pytest.param(*item, id=item[0]) for item in fields()])
def test_every_field_says_what_it_means_and_its_true_default(name: str, described: dict[str, Any]) -> None:
    description = described["description"]
    assert description.endswith(".")
    default = described.get("default")
    if not isinstance(default, str | int | float | bool):
        return
    if default == "":
        assert description.endswith("Default: empty.")
        return
    shown = json.dumps(default) if isinstance(default, bool) else str(default)
    stated = re.search(r"Default ([^\s,]+?)[.,]?(\s|$)", description)
    assert stated is not None, "a field with a default states it"
    assert stated.group(1) == shown


def test_the_schema_knows_units_ranges_and_patterns() -> None:
    schema = RobotOffload.model_json_schema(mode="serialization")
    timeout = schema["$defs"]["Switching"]["properties"]["lossTimeout"]
    assert timeout["type"] == "string"
    assert "default" not in timeout, "it follows from the heartbeats"
    assert schema["$defs"]["Switching"]["properties"]["activationDeadline"]["default"] == "250ms"
    assert timeout["x-kubernetes-validations"][0]["message"] == "must be between 15ms and 10s"
    assert schema["$defs"]["Node"]["properties"]["placement"]["enum"] == ["Robot", "Cloud", "Duplicated"]
    assert "pattern" in schema["$defs"]["TopicToCloud"]["properties"]["name"]
