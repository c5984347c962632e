"""What nodes do beyond what is declared, from a graph's answers to the line that a user adds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from robot_offload_agent.ros.undeclared import Declared, Undeclared
from robot_offload_agent.settings.parameters import Configuration, load

PARAMETERS: dict[str, Any] = {
    "side": "robot",
    "uid": "undeclared-1",
    "link": {"type": "ros"},
    "nodes": ["controller"],
    "node": {"controller": {"duplicated": True}},
    "outputs": ["cmd_vel"],
    "output": {
        "cmd_vel": {
            "topic": "/cmd_vel",
            "type": "geometry_msgs/msg/Twist",
            "node": "controller",
            "robot_topic": "/offload/robot/cmd_vel",
            "cloud_topic": "/offload/cloud/cmd_vel",
        }
    },
    "actions": ["drive"],
    "action": {
        "drive": {"name": "/drive", "type": "test_msgs/action/Fibonacci", "on_switch": "Resend", "node": "controller"}
    },
    "services": ["ask"],
    "service": {"ask": {"name": "/ask", "type": "std_srvs/srv/Trigger", "node": "controller"}},
    "silent": ["debug/**"],
}
DECLARED = {
    "publisher": [
        ("/offload/robot/cmd_vel", ["geometry_msgs/msg/Twist"]),
        ("/offload/robot/drive/_action/feedback", ["test_msgs/action/Fibonacci_FeedbackMessage"]),
        ("/controller/own", ["std_msgs/msg/String"]),
        ("/debug/path", ["nav_msgs/msg/Path"]),
        ("/rosout", ["rcl_interfaces/msg/Log"]),
    ],
    "service": [
        ("/controller/get_parameters", ["rcl_interfaces/srv/GetParameters"]),
        ("/offload/robot/ask", ["std_srvs/srv/Trigger"]),
        ("/offload/robot/drive/_action/send_goal", ["test_msgs/action/Fibonacci_SendGoal"]),
    ],
    "client": [("/controller/get_state", ["lifecycle_msgs/srv/GetState"])],
}


class Asked:
    """A graph with one node, as rclpy answers."""

    def __init__(self, **more: list[tuple[str, list[str]]]) -> None:
        self.known = {kind: named + more.get(kind, []) for kind, named in DECLARED.items()}

    def __getattr__(self, name: str) -> Any:
        kind = name.removeprefix("get_").removesuffix("_names_and_types_by_node")

        def answer(node: str, namespace: str) -> list[tuple[str, list[str]]]:
            if (node, namespace) != ("controller", "/"):
                raise RuntimeError("no such node")
            return self.known[kind]

        return answer


@pytest.fixture
def configuration(tmp_path: Path) -> Configuration:
    file = tmp_path / "robot.yaml"
    file.write_text(yaml.safe_dump({"/**": {"ros__parameters": PARAMETERS}}))
    return load(file)


def found(configuration: Configuration, **more: list[tuple[str, list[str]]]) -> Undeclared:
    return Declared(configuration, Asked(**more)).compare({"controller": "/controller"})["controller"]


def test_what_is_declared_silent_or_the_nodes_own_is_no_warning(configuration: Configuration) -> None:
    assert list(found(configuration)) == []


def test_a_node_that_is_not_in_the_graph_is_left_out(configuration: Configuration) -> None:
    assert Declared(configuration, Asked()).compare({"planner": "/planner"}) == {}


def test_an_undeclared_topic_is_named_with_the_line_to_add(configuration: Configuration) -> None:
    warning = found(configuration, publisher=[("/plan", ["nav_msgs/msg/Path"])]).publishes
    assert warning.endswith("Add to the node: outputs: [{topic: /plan, type: nav_msgs/msg/Path}]")


def test_an_undeclared_action_is_one_name_and_no_topic(configuration: Configuration) -> None:
    warnings = found(
        configuration,
        publisher=[("/spin/_action/feedback", ["nav2_msgs/action/Spin_FeedbackMessage"])],
        service=[
            ("/spin/_action/send_goal", ["nav2_msgs/action/Spin_SendGoal"]),
            ("/spin/_action/get_result", ["nav2_msgs/action/Spin_GetResult"]),
            ("/clear", ["std_srvs/srv/Trigger"]),
        ],
    )
    assert warnings.publishes == ""
    line = "actions: [{name: /spin, type: nav2_msgs/action/Spin, onSwitch: Abort}], services: [{name: /clear, type:"
    assert line in warnings.serves


def test_a_call_outside_the_group_is_named_and_one_inside_is_not(configuration: Configuration) -> None:
    calls = [("/reload_map", ["std_srvs/srv/Trigger"]), ("/offload/robot/ask", ["std_srvs/srv/Trigger"])]
    inside = [*calls, ("/inner", ["std_srvs/srv/Trigger"])]
    warnings = found(configuration, client=inside, service=[("/inner", ["std_srvs/srv/Trigger"])])
    assert "uses: {services: [{name: /reload_map, type: std_srvs/srv/Trigger}]}" in warnings.calls
    assert "/inner" not in warnings.calls
