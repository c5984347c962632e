"""Names and run arguments of each side's replicas."""

from __future__ import annotations

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.api.v1alpha1.names import Side, identifier
from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload.render.ros_names import (
    command,
    nodes_on,
    parameter_text,
    parameters,
    private_topic,
    remappings,
    replica_name,
)
from tests.unit.specs import changed, sample

OFFLOAD = parse_object(sample(), "sample")
BASE, CONTROLLER, PLANNER = OFFLOAD.spec.nodes


def changed_offload(path: str, value: object) -> RobotOffload:
    return parse_object(changed(path, value), "changed")


def test_topics_have_identifiers_and_private_names() -> None:
    assert identifier("/cmd_vel") == "cmd_vel"
    assert identifier("/arm/joint_states") == "arm__joint_states"
    assert private_topic("robot", "/cmd_vel") == "/offload/robot/cmd_vel"
    assert private_topic("cloud", "/a/b") == "/offload/cloud/a/b"


def test_only_the_cloud_replica_of_a_duplicated_node_is_renamed() -> None:
    assert replica_name(CONTROLLER, "robot") == "controller"
    assert replica_name(CONTROLLER, "cloud") == "remote_controller"
    assert replica_name(PLANNER, "cloud") == "planner"


def test_each_side_runs_its_own_nodes_and_the_duplicated_ones_in_order() -> None:
    assert [node.name for node in nodes_on(OFFLOAD.spec, "robot")] == ["wheelchair_base", "controller"]
    assert [node.name for node in nodes_on(OFFLOAD.spec, "cloud")] == ["controller", "planner"]


def test_the_robots_replica_publishes_privately_under_its_own_name() -> None:
    assert command(OFFLOAD.spec, CONTROLLER, "robot") == (
        *("python3", "controller.py", "--ros-args"),
        *("-r", "controller:__node:=controller"),
        *("-r", "cmd_vel_nav:=/offload/robot/cmd_vel"),
        *("-r", "/cmd_vel:=/offload/robot/cmd_vel"),
        *("-p", "rate_hz:=20.0", "-p", "max_speed:=0.6", "-p", 'plugins.names:=["a", "b"]'),
    )


def test_the_clouds_replica_has_the_prefix_and_its_own_parameters() -> None:
    assert command(OFFLOAD.spec, CONTROLLER, "cloud") == (
        *("python3", "controller.py", "--ros-args"),
        *("-r", "controller:__node:=remote_controller"),
        *("-r", "cmd_vel_nav:=/offload/cloud/cmd_vel"),
        *("-r", "/cmd_vel:=/offload/cloud/cmd_vel"),
        *("-p", "rate_hz:=50.0", "-p", "max_speed:=0.9", "-p", 'plugins.names:=["a", "b"]'),
    )


def test_a_node_of_a_package_is_started_with_ros2_run() -> None:
    assert command(OFFLOAD.spec, PLANNER, "cloud") == (
        *("ros2", "run", "nav2_planner", "planner_server", "--ros-args", "-r", "planner:__node:=planner"),
    )


def test_outputs_of_a_node_that_is_not_duplicated_stay_where_they_are() -> None:
    offload = changed_offload("spec.nodes.0.outputs", [{"topic": "/imu"}])
    assert remappings(offload.spec, offload.spec.nodes[0], "robot") == {}


def test_a_namespace_rule_names_the_new_name() -> None:
    offload = changed_offload("spec.robot.namespace", "/wheelchair_7")
    arguments = command(offload.spec, offload.spec.nodes[1], "cloud")
    assert arguments[4:6] == ("controller:__node:=remote_controller", "-r")
    assert arguments[6] == "remote_controller:__ns:=/wheelchair_7"


def test_a_relative_remapping_to_an_output_is_followed_through_the_namespace() -> None:
    values = changed("spec.nodes.1.run.remap", {"cmd_vel_nav": "cmd_vel", "tf": "/tf"})
    values["spec"]["robot"]["namespace"] = "/w7"
    values["spec"]["nodes"][1]["outputs"][0]["topic"] = "/w7/cmd_vel"
    spec = parse_object(values, "f").spec
    assert remappings(spec, spec.nodes[1], "robot") == {
        "cmd_vel_nav": "/offload/robot/w7/cmd_vel",
        "tf": "/tf",
        "/w7/cmd_vel": "/offload/robot/w7/cmd_vel",
    }


def test_a_node_without_a_run_block_cannot_be_started() -> None:
    offload = changed_offload("spec.nodes.0.run", ...)
    with pytest.raises(ValueError, match="'wheelchair_base' has no run block"):
        command(offload.spec, offload.spec.nodes[0], "robot")
    assert parameters(None, "robot") == {}


PLAIN = (
    st.booleans()
    | st.integers(min_value=-(2**63), max_value=2**63 - 1)
    | st.floats(allow_nan=False)
    | st.text(st.characters(codec="utf-8", exclude_categories=["Cc", "Cs"]), max_size=20)
)


@given(PLAIN | st.lists(st.text("ab:'\"# ,-\\0", max_size=5), min_size=1, max_size=3))
def test_a_parameter_keeps_its_value_and_type_as_text(value: object) -> None:
    text = parameter_text(value)
    read = yaml.safe_load(text)
    if isinstance(value, float) and "e" in text and "inf" not in text:
        read = float(text)  # YAML 1.1 wants a dot before an exponent; ROS 2 reads it with strtod.
    assert read == value
    assert type(read) is type(value)


PARTS = ("send_goal", "cancel_goal", "get_result", "feedback", "status")
FOLLOW = {"name": "/follow_path", "type": "nav2_msgs/action/FollowPath", "onSwitch": "Resend"}
PLAN = {"name": "/make_plan", "type": "nav_msgs/srv/GetPlan"}


def rules_of(node: dict[str, object], side: Side = "robot", namespace: str = "/") -> dict[str, str]:
    values = changed("spec.nodes", [{"name": "server", "placement": "Duplicated", **node}])
    values["spec"]["robot"]["namespace"] = namespace
    offload = parse_object(values, "f", rules=())
    return remappings(offload.spec, offload.spec.nodes[0], side)


def test_an_action_is_moved_by_its_five_hidden_names() -> None:
    rules = rules_of({"actions": [FOLLOW]}, "cloud")
    assert rules == {f"/follow_path/_action/{it}": f"/offload/cloud/follow_path/_action/{it}" for it in PARTS}


def test_services_used_names_and_the_topic_that_restores_state_are_private() -> None:
    used = {"services": [PLAN | {"name": "/map"}], "actions": [FOLLOW | {"name": "/dock"}]}
    del used["actions"][0]["onSwitch"]
    rules = rules_of({"services": [PLAN], "uses": used, "state": [{"topic": "/pose", "restore": "/initialpose"}]})
    assert {rules.pop(f"/dock/_action/{it}") for it in PARTS} == {f"/offload/robot/dock/_action/{it}" for it in PARTS}
    assert rules == {it: f"/offload/robot{it}" for it in ("/make_plan", "/map", "/initialpose")}


def test_a_users_rule_that_leads_to_a_declared_name_leads_to_the_private_one_at_once() -> None:
    run = {"command": ["a"], "remap": {"follow": "follow_path", "plan": "/seven/make_plan", "other": "/x"}}
    names = {"actions": [FOLLOW | {"name": "/seven/follow_path"}], "services": [PLAN | {"name": "/seven/make_plan"}]}
    rules = rules_of({"run": run, **names}, namespace="/seven")
    assert rules["follow/_action/send_goal"] == "/offload/robot/seven/follow_path/_action/send_goal"
    assert (rules["plan"], rules["other"], "follow" in rules) == ("/offload/robot/seven/make_plan", "/x", False)
    assert rules["/seven/follow_path/_action/status"] == "/offload/robot/seven/follow_path/_action/status"


def test_a_client_in_the_group_calls_the_server_of_its_own_side() -> None:
    used = {name: it for name, it in FOLLOW.items() if name != "onSwitch"}
    assert rules_of({"uses": {"actions": [used]}}) == rules_of({"actions": [FOLLOW]})


def test_the_output_of_a_node_that_only_the_cloud_has_is_private_there() -> None:
    node = {"placement": "Cloud", "outputs": [{"topic": "/objects"}]}
    assert rules_of(node, "cloud") == {"/objects": "/offload/cloud/objects"}
    assert rules_of(node | {"placement": "Robot"}) == {}
