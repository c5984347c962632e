"""Rules between fields: each breach gives one finding with its path, reason and advice."""

from __future__ import annotations

from typing import Any

import pytest

from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload.api.v1alpha1.rules import CLUSTER_CHECKS, check
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
    ("spec.transport.type", "DDSRouter", "spec.transport.zenoh", "WrongBlock", "belongs to transport type Zenoh"),
    ("spec.nodes.0.name", "planner", "spec.nodes[2].name", "DuplicateNode", "first at spec.nodes[0].name"),
    ("spec.topics.toCloud.1.name", "/scan", "spec.topics.toCloud[1].name", "DuplicateTopic", "listed twice"),
    ("spec.topics.toCloud.1.name", "/cmd_vel", "spec.topics.toCloud[1].name", "AlsoAnOutput", "crosses by itself"),
    ("spec.topics.toCloud.2.qos.durability", "Volatile", "spec.topics.toCloud[2].qos.durability", "Contradiction",
     "latched: false"),
    ("spec.nodes.1.outputs.0.rate", ..., "spec.nodes[1].outputs[0].deadline", "NoRate", "add its rate"),
    ("spec.nodes.1.outputs.0.deadline", "50ms", "spec.nodes[1].outputs[0].deadline", "TooShort", "at least 101ms"),
    ("spec.nodes.1.run.package", "nav2", "spec.nodes[1].run", "TwoPrograms", "keep one"),
    ("spec.nodes.1.run.command", ..., "spec.nodes[1].run", "NoProgram", "needs either command"),
    ("spec.nodes.2.run.executable", ..., "spec.nodes[2].run", "NoProgram", "needs either command"),
    ("spec.nodes.1.run.remap", {"/cmd_vel": "/other"}, "spec.nodes[1].run.remap", "RemapsOutput", "consumers know"),
    ("spec.transport", {"type": "DiscoveryServer"}, "spec.cloud.domainID", "DomainsDiffer", "the robot's is 42"),
    ("spec.transport.expose", {"nodePorts": {"pulse": 30001, "data": 30001}}, "spec.transport.expose.nodePorts",
     "SamePort", "one purpose"),
    ("spec.cloud.imagePullSecrets", [{"name": "a"}, {"name": "a"}], "spec.cloud.imagePullSecrets[1].name",
     "DuplicateSecret", "remove one"),
    ("spec.nodes.1.env", [{"name": "A"}, {"name": "A"}], "spec.nodes[1].env[1].name", "DuplicateVariable",
     "set twice"),
    ("spec.nodes.1.env", [{"name": "ROS_DOMAIN_ID"}], "spec.nodes[1].env[0].name", "ReservedVariable", "remove it"),
    ("spec.nodes.1.outputs.1", {"topic": "/cmd_vel"}, "spec.nodes[1].outputs[1].topic", "DuplicateOutput",
     "an output of two nodes"),
]  # fmt: skip
WARNINGS = [
    ("spec.robot.domainID", 150, "spec.robot.domainID", "EphemeralPorts"),
    ("spec.cloud.domainID", 150, "spec.cloud.domainID", "EphemeralPorts"),
    ("spec.nodes.1.outputs", [], "spec.nodes[1].outputs", "NothingCollected"),
    ("spec.nodes.0.standby", {"robot": "Hot"}, "spec.nodes[0].standby", "NoStandby"),
    ("spec.nodes.0.outputs", [{"topic": "/imu"}], "spec.nodes[0].outputs[0]", "NotCollected"),
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
    assert [finding.reason for finding in errors_of(values)] == [
        "DuplicateNode",
        "AlwaysHot",
        "MultipleOfPeriod",
    ]


def test_topics_whose_identifiers_would_collide_are_refused() -> None:
    values = changed("spec.topics.toCloud", [{"name": "/a_/b"}, {"name": "/a/_b"}])
    [finding] = errors_of(values)
    assert (finding.path, finding.reason) == ("spec.topics.toCloud[1].name", "AmbiguousTopic")


def test_outputs_whose_identifiers_would_collide_are_refused() -> None:
    [finding] = errors_of(changed("spec.nodes.1.outputs", [{"topic": "/a_/b"}, {"topic": "/a/_b"}]))
    assert (finding.path, finding.reason) == ("spec.nodes[1].outputs[1].topic", "AmbiguousTopic")


SPEEDS = {"speeds": [1.0, 2.5], "plugins": {"gain": 3.0}}
WHOLE_DOUBLES = [
    ("spec.nodes.1.run.doubles", [], ["parameters.rate_hz", "cloudParameters.rate_hz"]),
    ("spec.nodes.1.run.parameters", SPEEDS, ["parameters.speeds", "parameters.plugins.gain"]),
    ("spec.nodes.1.run.doubles", ["rate_hz", "rate"], ["doubles[1]"]),
]


@pytest.mark.parametrize(("path", "value", "where"), WHOLE_DOUBLES)
def test_a_double_that_kubernetes_would_make_whole_is_a_warning(path: str, value: Any, where: list[str]) -> None:
    found = check(parse_object(changed(path, value), "f.yaml").spec)
    assert [finding.path for finding in found] == [f"spec.nodes[1].run.{name}" for name in where]
    assert {finding.severity for finding in found} == {"warning"}


CLUSTER_ERRORS = [
    ("spec.nodes.1.image", ..., "spec.nodes[1].image", "NoImage"),
    ("spec.nodes.2.run", ..., "spec.nodes[2].run", "NoProgram"),
    ("spec.robot.rmw", "rmw_cyclonedds_cpp", "spec.cloud.rmw", "CloudRmw"),
]


@pytest.mark.parametrize(("path", "value", "where", "reason"), CLUSTER_ERRORS)
def test_what_only_a_cluster_needs_is_an_error_there_alone(path: str, value: Any, where: str, reason: str) -> None:
    offload = parse_object(changed(path, value), "f.yaml")
    assert all(finding.severity == "warning" for finding in check(offload.spec))
    [finding] = check(offload.spec, CLUSTER_CHECKS)
    assert (finding.path, finding.reason, finding.severity) == (where, reason, "error")
    with pytest.raises(SpecError):
        parse_object(changed(path, value), "f.yaml", rules=CLUSTER_CHECKS)


def test_nodes_on_the_robot_need_neither_image_nor_program() -> None:
    values = changed("spec.nodes.0.run", ...)
    assert check(parse_object(values, "f.yaml", rules=CLUSTER_CHECKS).spec, CLUSTER_CHECKS) == ()


def test_static_peers_need_an_address_of_the_robot() -> None:
    values = changed("spec.transport", {"type": "StaticPeers"})
    del values["spec"]["cloud"]["domainID"]
    [finding] = errors_of(values)
    assert (finding.path, finding.reason) == ("spec.transport.staticPeers", "NoPeers")


def test_a_parameter_that_kubectl_may_have_renamed_is_a_warning() -> None:
    pose = {"initial_pose": {"x": 1.5, "true": 2.5}}
    found = check(parse_object(changed("spec.nodes.1.run.parameters", pose), "f.yaml").spec)
    misread = [finding for finding in found if finding.reason == "MisreadName"]
    assert [(it.path, it.severity) for it in misread] == [("spec.nodes[1].run.parameters.initial_pose.true", "warning")]


@pytest.mark.parametrize(("loss", "reasons"), [("1s", set()), ("1010ms", {"LongSilence"}), ("9999ms", {"LongSilence"})])
def test_a_loss_that_is_noticed_late_is_a_warning_where_somebody_waits_for_each_message(
    loss: str, reasons: set[str]
) -> None:
    values = changed("spec.switching.lossTimeout", loss)
    values["spec"]["switching"] |= {"lease": "15s", "maxCommandAge": "1s", "heartbeatPeriod": "30ms"}
    long = {one.reason for one in check(parse_object(values, "f.yaml", rules=()).spec) if one.reason == "LongSilence"}
    assert long == reasons
    del values["spec"]["nodes"][1]["outputs"]
    assert not [one for one in check(parse_object(values, "f.yaml", rules=()).spec) if one.reason == "LongSilence"]


def test_a_specification_that_would_weigh_on_the_api_server_is_refused() -> None:
    values = changed("spec.nodes.1.run.parameters", {f"p{number}": "x" * 4096 for number in range(70)})
    with pytest.raises(SpecError, match=r"spec: has 2\d\d\d\d\d bytes, more than 262144; move parameters"):
        parse_object(values, "f.yaml")
