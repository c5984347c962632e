"""The run arguments that we render do in ROS 2 what they say: names, namespace, topics, parameters."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import rclpy
from rclpy.action import ActionClient, ActionServer
from rclpy.context import Context
from rclpy.node import Node
from std_msgs.msg import String
from test_msgs.action import Fibonacci
from test_msgs.srv import Empty

from robot_offload.api.files import load
from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.api.v1alpha1.names import SIDES, Side
from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload.render.agent_config import AgentSite, agent_config, agent_parameters
from robot_offload.render.launch_file import node_rules
from robot_offload.render.ros_names import run_arguments
from robot_offload_agent.settings.parameters import flatten
from tests.unit.specs import changed, sample

pytestmark = [pytest.mark.ros, pytest.mark.core]
DOMAIN = 97


def namespaced() -> RobotOffload:
    values = changed("spec.robot.namespace", "/w7")
    controller = values["spec"]["nodes"][1]
    controller["outputs"][0]["topic"] = "/w7/cmd_vel"
    controller["run"]["remap"] = {"cmd_vel_nav": "cmd_vel", "odom": "/odometry"}
    controller["run"]["parameters"] = PARAMETERS
    return parse_object(values, "sample.yaml")


PARAMETERS: dict[str, Any] = {
    "whole": 20,
    "rate": 20.0,
    "tiny": 1e-07,
    "on": True,
    "digits": "20",
    "truth": "true",
    "empty": "",
    "quoted": 'a "b" \\ c: d, [e] # é',
    "names": ["a", "20"],
    "rates": [1.0, 2.0],
    "nested": {"deep": {"value": 5}},
}


SERVED = parse_object(
    changed(
        "spec.nodes.1",
        {
            "name": "controller",
            "placement": "Duplicated",
            "run": {"command": ["a"], "remap": {"plan": "/w7/make_plan"}},
            "actions": [{"name": "/w7/follow", "type": "test_msgs/action/Fibonacci", "onSwitch": "Resend"}],
            "services": [{"name": "/w7/make_plan", "type": "test_msgs/srv/Empty"}],
            "uses": {"actions": [{"name": "/dock", "type": "test_msgs/action/Fibonacci"}]},
        },
    ),
    "served.yaml",
    rules=(),
)


@pytest.fixture
def context(request: pytest.FixtureRequest) -> Iterator[Context]:
    context = Context()
    rclpy.init(args=["test", "--ros-args", *request.param], context=context, domain_id=DOMAIN)
    yield context
    context.try_shutdown()


def node_arguments(side: Side) -> tuple[str, ...]:
    offload = namespaced()
    return run_arguments(offload.spec, offload.spec.nodes[1], side)


@pytest.mark.parametrize(
    ("context", "side", "name"),
    [(node_arguments("robot"), "robot", "controller"), (node_arguments("cloud"), "cloud", "remote_controller")],
    indirect=["context"],
)
def test_a_replica_gets_its_name_namespace_and_private_outputs(context: Context, side: str, name: str) -> None:
    node = Node("controller", context=context, start_parameter_services=False)
    other = Node("helper", context=context, start_parameter_services=False)
    try:
        assert node.get_fully_qualified_name() == f"/w7/{name}"
        assert other.get_fully_qualified_name() == "/helper", "only the node meant is renamed"
        for topic, expected in {
            "cmd_vel": f"/offload/{side}/w7/cmd_vel",
            "/w7/cmd_vel": f"/offload/{side}/w7/cmd_vel",
            "cmd_vel_nav": f"/offload/{side}/w7/cmd_vel",
            "odom": "/odometry",
            "scan": "/w7/scan",
        }.items():
            publisher = node.create_publisher(String, topic, 1)
            assert publisher.topic_name == expected
            node.destroy_publisher(publisher)
    finally:
        other.destroy_node()
        node.destroy_node()


def launch_arguments() -> tuple[str, ...]:
    """What launch gives to every process and container for the rules of the bundle's launch file."""
    return tuple(word for source, target in node_rules(namespaced()) for word in ("-r", f"{source}:={target}"))


@pytest.mark.parametrize("context", [launch_arguments()], indirect=True)
def test_rules_of_the_launch_file_touch_only_their_node_in_a_process_with_others(context: Context) -> None:
    node = Node("controller", namespace="/w7", context=context, start_parameter_services=False)
    other = Node("teleop", namespace="/w7", context=context, start_parameter_services=False)
    try:
        for name, expected in (("cmd_vel", "cmd_vel"), ("cmd_vel_nav", "cmd_vel"), ("/w7/cmd_vel", "cmd_vel")):
            assert node.create_publisher(String, name, 1).topic_name == f"/offload/robot/w7/{expected}"
        assert other.create_publisher(String, "cmd_vel", 1).topic_name == "/w7/cmd_vel"
        assert other.create_publisher(String, "cmd_vel_nav", 1).topic_name == "/w7/cmd_vel_nav"
    finally:
        other.destroy_node()
        node.destroy_node()


CONTAINER = Context()
NAV2 = load(Path(__file__).parents[2] / "manifests/samples/nav2.yaml")


def composed(node: str, own: tuple[str, ...], rules: tuple[tuple[str, str], ...]) -> Node:
    """A node as a container starts it: all rules of the launch file as its own arguments, then those of Nav2's file."""
    words = [word for source, target in rules for word in ("-r", f"{source}:={target}")]
    words += [word for rule in own for word in ("-r", rule)]
    return Node(node, cli_args=["--ros-args", *words], context=CONTAINER, start_parameter_services=False)


def test_components_of_nav2_in_one_container_get_their_own_rules_before_nav2s() -> None:
    """`/tf` of amcl alone is private, `cmd_vel` of each node leads where the sample says, children stay public."""
    rclpy.init(args=[], context=CONTAINER, domain_id=DOMAIN)
    rules, transforms = node_rules(NAV2), ("/tf:=tf", "/tf_static:=tf_static")
    nodes = {name: composed(name, transforms, rules) for name in ("amcl", "planner_server", "local_costmap")}
    moving = (*transforms, "cmd_vel:=cmd_vel_nav")
    nodes |= {name: composed(name, moving, rules) for name in ("controller_server", "behavior_server", "teleop")}
    nodes["velocity_smoother"] = composed("velocity_smoother", moving, rules)
    try:
        for name, topic, expected in (
            ("amcl", "/tf", "/offload/robot/tf"),
            ("amcl", "initialpose", "/offload/robot/initialpose"),
            ("planner_server", "/tf", "/tf"),
            ("planner_server", "plan", "/offload/robot/plan"),
            ("local_costmap", "/tf", "/tf"),
            ("local_costmap", "plan", "/plan"),
            ("controller_server", "cmd_vel", "/offload/robot/cmd_vel_nav"),
            ("behavior_server", "cmd_vel", "/offload/robot/cmd_vel_behavior"),
            ("velocity_smoother", "cmd_vel", "/cmd_vel_mux"),
            ("velocity_smoother", "cmd_vel_smoothed", "/cmd_vel_smoothed"),
            ("teleop", "cmd_vel", "/cmd_vel_nav"),
        ):
            assert nodes[name].create_publisher(String, topic, 1).topic_name == expected, (name, topic)
    finally:
        for node in nodes.values():
            node.destroy_node()
        CONTAINER.try_shutdown()


@pytest.mark.parametrize("context", [node_arguments("robot")], indirect=True)
def test_parameters_arrive_with_their_values_and_types(context: Context) -> None:
    node = Node(
        "controller",
        context=context,
        automatically_declare_parameters_from_overrides=True,
        start_parameter_services=False,
    )
    try:
        for name, expected in flatten(PARAMETERS).items():
            value = node.get_parameter(name).value
            value = value if isinstance(value, str | int | float) else list(value)
            assert value == expected
            assert type(value) is type(expected)
    finally:
        node.destroy_node()


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("served", [False, True])
def test_ros_itself_reads_the_agent_configuration(side: Side, served: bool, tmp_path: Any) -> None:
    offload = SERVED if served else parse_object(sample(), "sample.yaml")
    site = AgentSite(side, "127.0.0.1", "ca.pem", "own.pem", "own.key")
    file = tmp_path / "params.yaml"
    file.write_text(agent_config(offload, site))
    context = Context()
    rclpy.init(args=["test", "--ros-args", "--params-file", str(file)], context=context, domain_id=DOMAIN)
    node = Node("guardian", context=context, automatically_declare_parameters_from_overrides=True)
    try:
        for name, expected in flatten(agent_parameters(offload, site)).items():
            value = node.get_parameter(name).value
            assert (list(value) if isinstance(expected, list) else value) == expected, name
    finally:
        node.destroy_node()
        context.try_shutdown()


HIDDEN = ("send_goal", "cancel_goal", "get_result")


@pytest.mark.parametrize("context", [run_arguments(SERVED.spec, SERVED.spec.nodes[1], "robot")], indirect=True)
def test_services_and_actions_get_their_private_names(context: Context) -> None:
    node = Node("controller", context=context, namespace="/w7", start_parameter_services=False)
    served = ActionServer(node, Fibonacci, "follow", lambda _: Fibonacci.Result())
    used = ActionClient(node, Fibonacci, "/dock")
    service = node.create_service(Empty, "plan", lambda _, answer: answer)
    try:
        found = dict(node.get_service_names_and_types_by_node(node.get_name(), node.get_namespace()))
        private = {f"/offload/robot/w7/follow/_action/{it}" for it in HIDDEN} | {"/offload/robot/w7/make_plan"}
        assert private <= set(found)
        called = dict(node.get_client_names_and_types_by_node(node.get_name(), node.get_namespace()))
        assert {f"/offload/robot/dock/_action/{it}" for it in HIDDEN} <= set(called)
        said = dict(node.get_publisher_names_and_types_by_node(node.get_name(), node.get_namespace()))
        assert {f"/offload/robot/w7/follow/_action/{it}" for it in ("feedback", "status")} <= set(said)
        public = {"/w7/follow", "/w7/make_plan", "/dock", "/w7/plan"}
        assert not [name for name in (*found, *called, *said) if name.partition("/_action")[0] in public]
    finally:
        served.destroy()
        used.destroy()
        node.destroy_service(service)
        node.destroy_node()
