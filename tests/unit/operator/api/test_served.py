"""Rules about services, actions and state that look at several nodes at once, and what is said of their costs."""

from __future__ import annotations

from typing import Any

import pytest

from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload.api.v1alpha1.rules import check, not_yet
from robot_offload.findings import Finding
from tests.unit.specs import changed

FOLLOW = {"name": "/follow_path", "type": "nav2_msgs/action/FollowPath"}
RESENT = FOLLOW | {"onSwitch": "Resend"}
PLAN = {"name": "/make_plan", "type": "nav_msgs/srv/GetPlan"}

NODE = {"placement": "Duplicated", "image": "a:1"}


def found(*nodes: dict[str, Any], **topics: Any) -> list[Finding]:
    """What the rules say of these nodes, words that are not built yet aside."""
    values = changed("spec.nodes", [NODE | {"name": f"n{i}"} | it for i, it in enumerate(nodes)])
    values["spec"]["topics"] = topics
    findings = check(parse_object(values, "f.yaml", rules=()).spec)
    return [finding for finding in findings if finding.reason != not_yet.REASON]


def reasons(*nodes: dict[str, Any], **topics: Any) -> list[tuple[str, str]]:
    return [(finding.path, finding.reason) for finding in found(*nodes, **topics)]


def test_clients_and_servers_of_one_group_are_fine() -> None:
    nodes = ({"actions": [RESENT], "services": [PLAN]}, {"uses": {"actions": [FOLLOW], "services": [PLAN]}})
    assert reasons(*nodes) == []


def test_two_nodes_that_offer_one_name_are_refused() -> None:
    assert reasons({"services": [PLAN]}, {"services": [PLAN]}) == [("spec.nodes[1].services[0].name", "ServedTwice")]
    both = {"services": [PLAN], "actions": [RESENT | {"name": "/make_plan"}]}
    assert reasons(both) == [("spec.nodes[0].actions[0].name", "ServedTwice")]


@pytest.mark.parametrize(
    ("node", "topics"),
    [
        ({"outputs": [{"topic": "/make_plan"}], "services": [PLAN]}, {}),
        ({"services": [PLAN]}, {"toCloud": [{"name": "/make_plan"}]}),
        ({"uses": {"services": [PLAN]}}, {"toCloud": [{"name": "/make_plan"}]}),
    ],
)
def test_a_name_that_is_a_topic_as_well_is_refused(node: dict[str, Any], topics: dict[str, Any]) -> None:
    [finding] = found(node, **topics)
    assert finding.reason == "TwoMeanings"
    assert "rename one of the two" in finding.message


def test_names_that_differ_only_in_underscores_are_refused() -> None:
    services = [PLAN | {"name": "/a_/b"}, PLAN | {"name": "/a/_b"}]
    assert reasons({"services": services}) == [("spec.nodes[0].services[1].name", "AmbiguousName")]


@pytest.mark.parametrize(("server", "client"), [("Duplicated", "Cloud"), ("Cloud", "Duplicated")])
def test_a_client_that_nobody_would_serve_is_refused(server: str, client: str) -> None:
    offered = RESENT if server == "Duplicated" else FOLLOW
    nodes = ({"actions": [offered], "placement": server}, {"uses": {"actions": [FOLLOW]}, "placement": client})
    [finding] = found(*nodes)
    assert (finding.path, finding.reason) == ("spec.nodes[1].uses.actions[0].name", "NotServed")
    assert "give both nodes one placement" in finding.message


def test_a_name_outside_that_nodes_of_two_placements_use_is_refused() -> None:
    nodes = [{"uses": {"services": [PLAN]}, "placement": placement} for placement in ("Duplicated", "Cloud")]
    assert reasons(*nodes) == [("spec.nodes[1].uses.services[0].name", "TwoPlacements")]
    assert reasons(nodes[0], nodes[0]) == []


def test_a_client_with_another_type_than_the_server_is_refused() -> None:
    nodes = ({"services": [PLAN]}, {"uses": {"services": [PLAN | {"type": "nav_msgs/srv/GetMap"}]}})
    assert reasons(*nodes) == [("spec.nodes[1].uses.services[0].name", "OtherType")]


def test_a_condition_names_actions_that_are_declared() -> None:
    output = {"topic": "/cmd_vel", "rate": 20, "while": {"actions": ["/follow_path"]}}
    assert reasons({"outputs": [output], "actions": [RESENT]}) == []
    assert reasons({"outputs": [output]}) == [("spec.nodes[0].outputs[0].while.actions", "UnknownAction")]


@pytest.mark.parametrize(
    ("condition", "transport", "reason"),
    [
        ({"topic": "/scan", "within": "100ms"}, "Zenoh", None),
        ({"topic": "/scan", "within": "150ms"}, "Zenoh", "EndLooksLikeFault"),
        ({"topic": "/image", "within": "100ms"}, "Zenoh", "UnknownTopic"),
        ({"topic": "/scan", "within": "100ms"}, "StaticPeers", "UnknownTopic"),
    ],
)
def test_a_condition_names_a_topic_that_both_sides_see_and_ends_before_the_deadline(
    condition: dict[str, str], transport: str, reason: str | None
) -> None:
    output = {"topic": "/cmd_vel", "rate": 20, "while": condition}
    values = changed("spec.nodes", [NODE | {"name": "n0", "outputs": [output]}])
    values["spec"] |= {"topics": {"toCloud": [{"name": "/scan"}]}, "transport": {"type": transport}}
    findings = check(parse_object(values, "f.yaml", rules=()).spec)
    assert [f.reason for f in findings if ".while" in f.path] == ([] if reason is None else [reason])


@pytest.mark.parametrize("field", ["parameters", "cloudParameters"])
def test_a_duplicated_amcl_that_jumps_to_its_configured_pose_is_refused(field: str) -> None:
    run = {"package": "nav2_amcl", "executable": "amcl", field: {"set_initial_pose": True}}
    [finding] = found({"run": run})
    assert (finding.path, finding.reason) == (f"spec.nodes[0].run.{field}.set_initial_pose", "PoseJumps")
    assert found({"run": run, "placement": "Robot"}) == []
    assert found({"run": run | {field: {"set_initial_pose": False}}}) == []


def test_parameters_are_copied_between_replicas_and_of_child_nodes_only() -> None:
    copied = {"state": [{"parameters": {"nodes": ["n1", "local_costmap/local_costmap"]}}]}
    assert found(copied, {}) == []
    [finding] = found(copied, {"placement": "Robot"})
    assert (finding.path, finding.reason) == ("spec.nodes[0].state[0].parameters.nodes[0]", "NoReplica")


@pytest.mark.parametrize(
    ("node", "path"),
    [
        ({"standby": {"robot": "Hot"}}, "spec.nodes[0].standby.robot"),
        ({"lifecycle": False, "outputs": [{"topic": "/a"}]}, "spec.nodes[0].lifecycle"),
    ],
)
def test_a_node_that_computes_on_the_robot_all_the_time_is_a_warning(node: dict[str, Any], path: str) -> None:
    [finding] = found(node)
    assert (finding.path, finding.reason, finding.severity) == (path, "CostsTwice", "warning")


def test_a_best_effort_output_of_a_hot_node_is_a_warning() -> None:
    lossy = {"topic": "/a", "rate": 20, "qos": {"reliability": "BestEffort"}}
    [_, finding] = found({"standby": {"robot": "Hot"}, "outputs": [lossy]})
    assert (finding.path, finding.severity) == ("spec.nodes[0].outputs[0].qos.reliability", "warning")
    assert finding.reason == "LostMessagesEndStays"
    for node in (
        {"outputs": [lossy]},
        {"standby": {"robot": "Hot"}, "outputs": [lossy | {"qos": {"reliability": "Reliable"}}]},
        {"standby": {"robot": "Hot"}, "outputs": [{"topic": "/a", "qos": {"reliability": "BestEffort"}}]},
    ):
        assert "LostMessagesEndStays" not in {finding.reason for finding in found(node)}


def test_more_names_than_fit_are_refused() -> None:
    many = [{"services": [PLAN | {"name": f"/n{i}_{j}"} for j in range(16)]} for i in range(17)]
    assert reasons(*many) == [("spec.nodes", "TooMany")]


@pytest.mark.parametrize(
    ("topic", "words"),
    [
        ({"type": "sensor_msgs/msg/Image"}, "at 30 Hz are 221 Mbit/s"),
        ({"type": "sensor_msgs/msg/Image", "maxRate": 5}, "at 5 Hz are 37 Mbit/s"),
        ({"type": "sensor_msgs/msg/PointCloud2", "maxRate": 10}, "at 10 Hz are 37 Mbit/s"),
    ],
)
def test_raw_sensor_data_is_a_warning_with_an_estimate(topic: dict[str, Any], words: str) -> None:
    [finding] = found({"outputs": [{"topic": "/a"}]}, toCloud=[{"name": "/camera", **topic}])
    assert (finding.reason, finding.severity) == ("MuchForALink", "warning")
    assert words in finding.message


@pytest.mark.parametrize(
    "topic", [{"type": "sensor_msgs/msg/CompressedImage"}, {"type": "sensor_msgs/msg/Image", "maxRate": 1}]
)
def test_what_a_link_carries_is_no_warning(topic: dict[str, Any]) -> None:
    assert found({"outputs": [{"topic": "/a"}]}, toCloud=[{"name": "/camera", **topic}]) == []
