"""Rules between fields: each breach gives one finding with its path, reason and advice."""

from __future__ import annotations

from typing import Any

import pytest

from robot_offload.api.v1alpha1.checks import check
from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload.errors import SpecError
from robot_offload.findings import Finding
from tests.unit.specs import changed, sample

LATENCY = "spec.switching.latency"
ERRORS = [
    ("spec.switching.lossTimeout", "40ms", "spec.switching.lossTimeout", "TooShort", "not more than two"),
    ("spec.switching.lossTimeout", "80ms", "spec.switching.lossTimeout", "MultipleOfPeriod", "for example 90ms"),
    ("spec.switching.lease", "189ms", "spec.switching.lease", "TooShort", "at least 190ms"),
    ("spec.switching.maxCommandAge", "80ms", "spec.switching.maxCommandAge", "TooShort", "more than 80ms"),
    (f"{LATENCY}.cloudPeriod", "80ms", LATENCY, "NeverInCloud", "raise tolerance"),
    ("spec.switching.holdDown.max", "500ms", "spec.switching.holdDown.initial", "OutOfRange", "raise max"),
    ("spec.transport.type", "DDSRouter", "spec.transport.zenoh", "WrongBlock", "does not belong to"),
    ("spec.nodes.0.name", "planner", "spec.nodes[2].name", "DuplicateNode", "first at spec.nodes[0].name"),
    ("spec.topics.toCloud.1.name", "/scan", "spec.topics.toCloud[1].name", "DuplicateTopic", "listed twice"),
    ("spec.topics.toCloud.1.name", "/cmd_vel", "spec.topics.toCloud[1].name", "AlsoAnOutput", "crosses by itself"),
    ("spec.topics.toCloud.2.qos.durability", "Volatile", "spec.topics.toCloud[2].qos.durability", "Contradiction",
     "latched: false"),
    ("spec.nodes.1.lifecycle", False, "spec.nodes[1].lifecycle", "NotManaged", "lifecycle: true"),
    ("spec.nodes.1.outputs.0.rate", ..., "spec.nodes[1].outputs[0].deadline", "NoRate", "add its rate"),
    ("spec.nodes.1.outputs.0.deadline", "50ms", "spec.nodes[1].outputs[0].deadline", "TooShort", "at least 101ms"),
    ("spec.nodes.1.run.package", "nav2", "spec.nodes[1].run", "TwoPrograms", "keep one"),
    ("spec.nodes.1.run.command", ..., "spec.nodes[1].run", "NoProgram", "needs either command"),
    ("spec.nodes.2.run.executable", ..., "spec.nodes[2].run", "NoProgram", "needs either command"),
    ("spec.nodes.1.run.remap", {"/cmd_vel": "/other"}, "spec.nodes[1].run.remap", "RemapsOutput", "consumers know"),
    ("spec.nodes.1.outputs.1", {"topic": "/cmd_vel"}, "spec.nodes[1].outputs[1].topic", "DuplicateOutput",
     "an output of two nodes"),
]  # fmt: skip
WARNINGS = [
    ("spec.robot.domainID", 150, "spec.robot.domainID", "EphemeralPorts"),
    ("spec.cloud.domainID", 150, "spec.cloud.domainID", "EphemeralPorts"),
    ("spec.nodes.1.outputs", [], "spec.nodes[1].outputs", "NothingCollected"),
    ("spec.nodes.0.standby", {"robot": "Hot"}, "spec.nodes[0].standby", "NoStandby"),
    ("spec.nodes.0.outputs", [{"topic": "/imu"}], "spec.nodes[0].outputs[0]", "NotCollected"),
    ("spec.nodes.2.outputs", [{"topic": "/plan"}], "spec.nodes[2].outputs[0]", "NotCollected"),
    ("spec.driver.inhibitService", ..., "spec.driver.inhibitService", "NoInhibitService"),
]


def errors_of(values: dict[str, Any]) -> tuple[Finding, ...]:
    with pytest.raises(SpecError) as caught:
        parse_object(values, "f.yaml")
    return caught.value.findings


def test_the_sample_breaks_no_rule() -> None:
    assert check(parse_object(sample(), "f.yaml").spec) == ()


@pytest.mark.parametrize(("path", "value", "where", "reason", "advice"), ERRORS)
def test_a_broken_rule_refuses_the_specification(path: str, value: Any, where: str, reason: str, advice: str) -> None:
    [finding] = errors_of(changed(path, value))
    assert (finding.path, finding.reason, finding.severity) == (where, reason, "error")
    assert advice in finding.message


@pytest.mark.parametrize(("path", "value", "where", "reason"), WARNINGS)
def test_what_is_only_doubtful_is_a_warning(path: str, value: Any, where: str, reason: str) -> None:
    offload = parse_object(changed(path, value), "f.yaml")
    [finding] = check(offload.spec)
    assert (finding.path, finding.reason, finding.severity) == (where, reason, "warning")


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("spec.switching.lossTimeout", "41ms"),
        ("spec.switching.lease", "190ms"),
        ("spec.switching.maxCommandAge", "81ms"),
        (f"{LATENCY}.cloudPeriod", "79ms"),
        ("spec.nodes.1.outputs.0.deadline", "51ms"),
    ],
)
def test_a_value_just_inside_its_rule_is_taken(path: str, value: str) -> None:
    assert check(parse_object(changed(path, value), "f.yaml").spec) == ()


def test_several_broken_rules_are_told_together() -> None:
    values = changed("spec.switching.lossTimeout", "100ms")
    values["spec"]["nodes"][0]["name"] = "controller"
    values["spec"]["nodes"][1]["lifecycle"] = False
    assert [finding.reason for finding in errors_of(values)] == ["DuplicateNode", "NotManaged", "MultipleOfPeriod"]


def test_topics_whose_identifiers_would_collide_are_refused() -> None:
    values = changed("spec.topics.toCloud", [{"name": "/a_/b"}, {"name": "/a/_b"}])
    [finding] = errors_of(values)
    assert (finding.path, finding.reason) == ("spec.topics.toCloud[1].name", "AmbiguousTopic")


def test_outputs_whose_identifiers_would_collide_are_refused() -> None:
    [finding] = errors_of(changed("spec.nodes.1.outputs", [{"topic": "/a_/b"}, {"topic": "/a/_b"}]))
    assert (finding.path, finding.reason) == ("spec.nodes[1].outputs[1].topic", "AmbiguousTopic")
