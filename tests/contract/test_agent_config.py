"""The agent configuration: what the operator package renders is exactly what the agent reads."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from robot_offload.api.files import load
from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.api.v1alpha1.names import SIDES, Side
from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload.api.v1alpha1.quantities import format_duration
from robot_offload.errors import SpecError
from robot_offload.render.agent_config import AgentSite, agent_config, agent_parameters
from robot_offload_agent.settings import parameters as agent
from robot_offload_core.words.declared import Frame, ParameterState, SnapshotState, TopicState, While
from tests.unit.specs import changed, sample

EXAMPLES = sorted(Path(__file__).parents[2].glob("examples/*/robotoffload.yaml"))


def site(side: Side, **more: Any) -> AgentSite:
    return AgentSite(side, "127.0.0.1", "ca.pem", f"{side}.pem", f"{side}.key", **more)


def read_by_agent(text: str) -> agent.Configuration:
    return agent.parse(agent.flatten(yaml.safe_load(text)["/**"]["ros__parameters"]))


def rendered(path: str, value: Any, side: Side = "robot") -> dict[str, Any]:
    return agent_parameters(parse_object(changed(path, value), "f.yaml"), site(side))


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("file", EXAMPLES, ids=[file.parent.name for file in EXAMPLES])
def test_every_example_renders_to_what_the_agent_accepts(file: Path, side: Side, tmp_path: Path) -> None:
    params = tmp_path / "params.yaml"
    params.write_text(agent_config(load(file), site(side)))
    configuration = agent.load(params)
    assert configuration.side.value == side
    assert configuration.settings().beat_period_s > 0


def test_there_are_examples_to_render() -> None:
    assert EXAMPLES


@pytest.mark.parametrize("side", SIDES)
def test_every_parameter_of_the_agent_is_rendered_and_nothing_else(side: Side) -> None:
    text = agent_config(parse_object(sample(), "sample"), site(side))
    given_names = set(agent.flatten(yaml.safe_load(text)["/**"]["ros__parameters"]))
    assert given_names == set(read_by_agent(text).values)


def test_the_agent_reads_the_values_that_the_user_wrote() -> None:
    configuration = read_by_agent(agent_config(parse_object(sample(), "sample"), site("cloud", uid="u-1", domain_id=7)))
    assert (configuration["uid"], configuration["robot_name"], configuration["domain_id"]) == ("u-1", "wheelchair-7", 7)
    assert [node.name for node in configuration.nodes] == ["controller", "planner"]
    assert configuration.nodes[0]["standby_cloud"] == "Hot"
    [output] = configuration.outputs
    assert (output["topic"], output["cloud_topic"]) == ("/cmd_vel", "/offload/cloud/cmd_vel")
    assert (output["rate_hz"], output["deadline_ms"], output["mirror"]) == (20.0, 150.0, False)
    scan, odom, goal = configuration.inputs
    assert (scan["max_age_ms"], scan["max_rate_hz"], scan["reliability"]) == (300.0, 20.0, "best_effort")
    assert (odom["type"], odom["reliability"], odom["depth"]) == ("auto", "auto", 10)
    assert (goal["latched"], goal["durability"], goal["depth"]) == (True, "transient_local", 1)
    settings_ = configuration.settings()
    assert (settings_.loss_timeout_s, settings_.allowed_loop_s) == pytest.approx((0.09, 0.06))


def test_empty_lists_are_written_as_ros_can_read_them() -> None:
    parameters = rendered("spec.topics", {})
    assert parameters["inputs"] == ["none"]
    assert "input" not in parameters  # nor an empty mapping, which ROS cannot read in the middle of a file
    values = {**sample(), "spec": {"nodes": [{"name": "talker", "placement": "Robot"}]}}
    text = agent_config(parse_object(values, "f"), site("cloud"))
    configuration = read_by_agent(text)
    assert (configuration.nodes, configuration.outputs, configuration.inputs) == ((), (), ())


def test_without_a_fallback_there_is_no_fallback_endpoint() -> None:
    link = rendered("spec.transport.zenoh.fallback", False)["link"]
    assert link["pulse_fallback"] == link["data_fallback"] == ["none"]
    assert link["pulse_endpoints"] == ["quic/127.0.0.1:7447"]


def test_a_dds_transport_has_no_endpoints() -> None:
    link = rendered("spec.transport", {"type": "DDSRouter"})["link"]
    assert link["type"] == "ros"
    assert link["pulse_endpoints"] == link["data_endpoints"] == link["data_fallback"] == ["none"]


def test_ports_seen_through_a_wire_or_a_service_replace_those_of_the_resource() -> None:
    offload = parse_object(sample(), "sample")
    robot = AgentSite("robot", "fd00::1", "ca", "c", "k", pulse_port=30001, data_port=30002, verify_name=False)
    link = agent_parameters(offload, robot)["link"]
    assert link["pulse_endpoints"] == ["quic/[fd00::1]:30001"]
    assert link["data_fallback"] == ["tls/[fd00::1]:30002"]
    assert link["verify_name"] is False


RATE = st.floats(min_value=0.05, max_value=1000)


def ms(low: int, high: int) -> st.SearchStrategy[str]:
    return st.integers(low, high).map(format_duration)


@st.composite
def switchings(draw: st.DrawFn) -> dict[str, Any]:
    """Times around the edges of the rules between them, most of them accepted, some just beyond."""
    beat, robot, tolerance = draw(st.integers(5, 200)), draw(st.integers(1, 2000)), draw(st.integers(0, 2000))
    cloud = draw(st.integers(1, robot + tolerance))
    loss = max(15, 2 * beat + draw(st.integers(1, 4 * beat)))
    loop = robot + tolerance - cloud
    initial = draw(st.integers(0, 600_000))
    edge = st.integers(-1, 3) | st.integers(0, 3000)
    written = {
        "heartbeatPeriod": beat,
        "lossTimeout": loss,
        "lease": max(50, loss + loop + 2 * beat + draw(edge)),
        "maxCommandAge": max(10, loop + beat + 1 + draw(edge)),
    }
    return {
        **{name: format_duration(value) for name, value in written.items()},
        "latency": {
            "robotPeriod": format_duration(robot),
            "cloudPeriod": format_duration(cloud),
            "tolerance": format_duration(tolerance),
        },
        "holdDown": {
            "initial": format_duration(initial),
            "max": format_duration(max(0, initial + draw(edge))),
            "flapWindow": draw(ms(0, 3_600_000)),
        },
        "minDwell": draw(ms(0, 3_600_000)),
        "maxClockOffset": draw(ms(1, 10_000)),
        "activationDeadline": draw(ms(10, 60_000)),
        "prefer": draw(st.sampled_from(["Cloud", "Robot"])),
        "pin": draw(st.sampled_from(["Auto", "Cloud", "Robot"])),
        "mode": draw(st.sampled_from(["Auto", "Observe"])),
        "strict": draw(st.booleans()),
    }


@settings(deadline=None, max_examples=150, suppress_health_check=[HealthCheck.filter_too_much])
@given(
    switching=switchings(),
    output=st.fixed_dictionaries({"topic": st.just("/a/b")}, optional={"rate": RATE, "deadline": ms(1, 60_000)}),
    topic=st.fixed_dictionaries(
        {"name": st.just("/c")}, optional={"maxAge": ms(1, 600_000), "maxRate": RATE, "latched": st.booleans()}
    ),
    side=st.sampled_from(SIDES),
)  # fmt: skip
def test_whatever_the_specification_accepts_the_agent_accepts(
    switching: dict[str, Any], output: dict[str, Any], topic: dict[str, Any], side: Side
) -> None:
    offload = accepted(
        {
            "switching": switching,
            "nodes": [{"name": "n", "placement": "Duplicated", "outputs": [output]}],
            "topics": {"toCloud": [topic]},
        }
    )
    read_by_agent(agent_config(offload, site(side)))


@pytest.mark.parametrize("rate", [0.05, 1000])
def test_the_slowest_and_the_fastest_output_are_accepted_by_the_agent(rate: float) -> None:
    offload = parse_object(changed("spec.nodes.1.outputs", [{"topic": "/a", "rate": rate}]), "f.yaml")
    [output] = read_by_agent(agent_config(offload, site("robot"))).outputs
    assert output["deadline_ms"] == max(100.0, 3000.0 / rate)


def accepted(spec: dict[str, Any]) -> RobotOffload:
    values = {
        "apiVersion": "robotoffload.dev/v1alpha1",
        "kind": "RobotOffload",
        "metadata": {"name": "r"},
        "spec": spec,
    }
    try:
        return parse_object(values, "f.yaml")
    except SpecError:
        assume(False)
        raise


FOLLOW = {"name": "/follow_path", "type": "nav2_msgs/action/FollowPath"}
CLEAR = {"name": "/costmap/clear", "type": "std_srvs/srv/Empty"}
EVERY_WORD: dict[str, Any] = {
    "name": "controller",
    "placement": "Duplicated",
    "core": True,
    "standby": {"robot": "Hot", "cloud": "Warm"},
    "outputs": [
        {"topic": "/cmd_vel", "rate": 20, "while": {"actions": ["/follow_path"]}, "shared": True},
        {"topic": "/tf", "frames": [{"parent": "map", "child": "odom"}]},
        {"topic": "/boxes", "rate": 30, "while": {"topic": "/image", "within": "50ms"}},
    ],
    "services": [CLEAR | {"mode": "Both", "timeout": "1s"}],
    "actions": [FOLLOW | {"onSwitch": "Hold", "holdFor": "3s", "resultTimeout": "1m", "accept": "Holder"}],
    "uses": {
        "services": [{"name": "/map", "type": "nav_msgs/srv/GetMap"}],
        "actions": [{"name": "/dock", "type": "nav2_msgs/action/DockRobot", "cancelAfter": "0s"}],
    },
    "state": [
        {"topic": "/amcl_pose", "restore": "/initialpose"},
        {"parameters": {"nodes": ["controller", "local_costmap/local_costmap"], "except": ["use_gpu"]}},
        {"snapshot": True, "maxAge": "1s", "maxSize": "2Mi"},
    ],
}
"""A node that says everything about what moves with the execution."""


def with_every_word() -> RobotOffload:
    values = changed("spec.nodes.1", EVERY_WORD)
    values["spec"]["switching"] |= {"silent": ["local_costmap/**"], "maxMessageSize": "1Mi", "settleFor": "3s"}
    values["spec"]["topics"]["toCloud"][0] |= {
        "minRate": 2, "priority": "High", "latest": True, "type": "sensor_msgs/msg/Image",
    }  # fmt: skip
    return parse_object(values, "f.yaml", rules=())


@pytest.mark.parametrize("side", SIDES)
def test_the_agent_reads_what_moves_with_the_execution(side: Side) -> None:
    configuration = read_by_agent(agent_config(with_every_word(), site(side)))
    plan = configuration.relay_plan()
    assert plan is not None
    [service], [action] = plan.services, plan.actions
    assert (service.mode.value, service.timeout_s, service.node, service.core) == ("Both", 1.0, "controller", True)
    assert (action.on_switch.value, action.hold_for_s, action.result_timeout_s) == ("Hold", 3.0, 60.0)
    assert (action.accept.value, [it.value for it in action.hot]) == ("Holder", ["robot"])
    assert ([it.name for it in plan.used_services], plan.used_actions[0].cancel_after_s) == (["/map"], 0.0)
    pose, parameters, snapshot = configuration.state_specs()
    assert (pose, parameters) == (
        TopicState("controller", "/amcl_pose", "/initialpose"),
        ParameterState("controller", ("controller", "local_costmap/local_costmap"), ("use_gpu",)),
    )
    assert snapshot == SnapshotState("controller", 1.0, 2 << 20)
    command, tf, boxes = configuration.output_specs()
    assert (command.while_, boxes.while_) == (While(("/follow_path",)), While(topic="/image", within_s=0.05))
    assert (command.shared, tf.shared, boxes.shared, tf.frames) == (True, True, False, (Frame("map", "odom"),))
    assert command.waits
    assert [it.value for it in command.hot] == ["robot"]
    settings_ = configuration.settings()
    assert (settings_.preparing_s, settings_.settle_for_s, settings_.max_message_size) == (5.0, 3.0, 1 << 20)
    scan = configuration.input_specs()[0]
    assert (scan.min_rate_hz, scan.max_rate_hz, scan.priority.value, scan.latest) == (2.0, 20.0, "High", True)
    assert configuration["silent"] == ["local_costmap/**"]


def test_without_actions_a_side_prepares_as_long_as_it_may_activate() -> None:
    settings_ = read_by_agent(agent_config(parse_object(sample(), "sample"), site("robot"))).settings()
    assert settings_.preparing_s == settings_.activation_deadline_s


def test_a_node_without_a_lifecycle_is_hot_on_both_sides() -> None:
    offload = parse_object(
        changed("spec.nodes.1", {"name": "a", "placement": "Duplicated", "lifecycle": False}), "f.yaml", rules=()
    )
    for side in SIDES:
        [node] = [it for it in read_by_agent(agent_config(offload, site(side))).node_specs() if it.name == "a"]
        assert node.hot


def test_what_the_group_offers_itself_is_no_used_name() -> None:
    client = {"name": "tree", "placement": "Duplicated", "uses": {"actions": [FOLLOW], "services": [CLEAR]}}
    values = changed("spec.nodes.1", EVERY_WORD)
    values["spec"]["nodes"][2] = client
    plan = read_by_agent(agent_config(parse_object(values, "f.yaml", rules=()), site("robot"))).relay_plan()
    assert plan is not None
    assert [it.name for it in plan.used_actions] == ["/dock"]
    assert [it.name for it in plan.used_services] == ["/map"]


def test_both_agents_know_what_only_the_cloud_makes() -> None:
    offload = parse_object(
        changed("spec.nodes.2.outputs", [{"topic": "/objects", "maxAge": "400ms"}]), "f.yaml", rules=()
    )
    for side in SIDES:
        specs = {it.name: it for it in read_by_agent(agent_config(offload, site(side))).output_specs()}
        assert (specs["objects"].of_cloud, specs["objects"].max_age_s) == (True, 0.4)
        assert not specs["cmd_vel"].of_cloud


def test_what_is_to_differ_in_the_cloud_may_differ_between_the_replicas() -> None:
    own = {"command": ["run"], "cloudParameters": {"rate_hz": 50.0, "plugins": {"speed": 0.6}}}
    for side in SIDES:
        parameters = rendered("spec.nodes.1.run", own, side)
        assert agent.flatten(parameters)["node.controller.may_differ"] == ["plugins.speed", "rate_hz"]
