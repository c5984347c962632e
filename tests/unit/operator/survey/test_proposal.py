"""What `import` proposes for graphs of several worlds: each is valid, and says why."""

from __future__ import annotations

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from robot_offload.api.files import load
from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.api.v1alpha1.nodes import Node
from robot_offload.api.v1alpha1.parsing import parse_text
from robot_offload.survey.fit import fitted
from robot_offload.survey.proposal import SurveyError, propose
from robot_offload.survey.snapshot import GraphSnapshot, NodeSeen
from robot_offload.survey.written import written
from tests.unit.operator.survey.graphs import (
    CONTROLLER,
    SCAN,
    STRING,
    TWIST,
    WHEELS,
    graph,
    node,
    process,
    small,
    topic,
    wheelchair,
)


def imported(seen: GraphSnapshot, **more: str) -> tuple[RobotOffload, str]:
    sketch = fitted(propose(seen, **more))
    text = written(sketch)
    assert yaml.safe_load(text) == sketch.values(), "the comments hide nothing and add nothing"
    return parse_text(text, "imported.yaml"), text


def nodes(offload: RobotOffload) -> dict[str, Node]:
    return {it.name: it for it in offload.spec.nodes}


def test_the_wheelchair_is_divided_as_its_own_file_divides_it() -> None:
    offload, _ = imported(wheelchair(), name="wheelchair", folder="/home/robot/wheelchair")
    own = load("examples/wheelchair/robotoffload.yaml")
    found, expected = nodes(offload), nodes(own)
    assert {name: it.placement for name, it in found.items()} == {name: it.placement for name, it in expected.items()}
    assert {name: it.lifecycle for name, it in found.items()} == {name: it.lifecycle for name, it in expected.items()}
    assert {it.name for it in offload.spec.topics.to_cloud} == {it.name for it in own.spec.topics.to_cloud}
    assert offload.spec.driver == own.spec.driver
    mine, theirs = found["controller"], expected["controller"]
    assert mine.core
    assert [(it.topic, it.type, it.rate_hz) for it in mine.outputs] == [
        (it.topic, it.type, it.rate_hz) for it in theirs.outputs
    ]
    assert [(it.name, it.type) for it in mine.offered] == [(it.name, it.type) for it in theirs.offered]
    assert mine.run is not None
    assert theirs.run is not None
    assert (mine.run.command, mine.run.remap) == (theirs.run.command, theirs.run.remap)
    assert mine.run.parameters == theirs.run.parameters
    assert [it.snapshot for it in found["localiser"].state] == [True]
    assert "/pose" in offload.spec.switching.silent
    assert offload.spec.switching.latency.robot_period_ms == own.spec.switching.latency.robot_period_ms


def test_reasons_and_figures_stand_beside_what_they_are_about() -> None:
    _, text = imported(wheelchair())
    assert "takes the commands of /cmd_vel and passes none on: it moves the robot" in text
    assert "it has no lifecycle" in text
    assert "6.2% of a core, 75 MiB" in text
    assert "51.2 Hz, 37.1 kB/s, Reliable Volatile; for /localiser" in text


def test_an_idle_graph_is_no_robot() -> None:
    with pytest.raises(SurveyError, match="no node was seen in ROS domain 7"):
        propose(graph([], domain_id=7))


def test_a_graph_of_the_agents_alone_is_no_robot() -> None:
    with pytest.raises(SurveyError):
        propose(graph([node("/guardian"), node("/remote_controller"), node("/_ros2cli_daemon")]))


def test_a_robot_with_nothing_to_share_is_written_down_all_the_same() -> None:
    offload, text = imported(graph([node("/robot_state_publisher", managed=False)]))
    assert nodes(offload)["robot_state_publisher"].placement == "Robot"
    assert "its process was not found" in text


def test_a_node_with_a_device_open_stays_on_the_robot() -> None:
    seen = graph([node("/arm")], processes=[process(7, "/ws/lib/arm/arm", "--ros-args", devices=("/dev/ttyUSB0",))])
    offload, text = imported(seen)
    assert nodes(offload)["arm"].placement == "Robot"
    assert "has /dev/ttyUSB0 open" in text


def test_a_driver_is_known_by_what_it_publishes_and_does_not_hear() -> None:
    seen = small()
    laser = seen.nodes[0].model_copy(update={"lifecycle": "active"})
    offload, text = imported(seen.model_copy(update={"nodes": (laser, *seen.nodes[1:])}))
    assert {name: it.placement for name, it in nodes(offload).items()} == {
        "laser": "Robot", "wheels": "Robot", "controller": "Duplicated",
    }  # fmt: skip
    assert "publishes /scan and hears nothing: it is a sensor's driver" in text


def test_wheels_that_only_say_how_far_they_turned_stay_on_the_robot() -> None:
    seen = small()
    scan = next(topic for topic in seen.topics if topic.name == "/scan")
    odom = scan.model_copy(update={"name": "/odom", "types": ("nav_msgs/msg/Odometry",)})
    others = tuple(topic for topic in seen.topics if topic != scan)
    wheels = seen.nodes[0].model_copy(update={"lifecycle": "active"})
    offload, text = imported(seen.model_copy(update={"nodes": (wheels, *seen.nodes[1:]), "topics": (odom, *others)}))
    assert nodes(offload)["laser"].placement == "Robot"
    assert "publishes /odom and hears nothing: it is a sensor's driver" in text


def test_of_two_publishers_of_one_topic_the_busier_one_leaves_and_the_topic_is_shared() -> None:
    seen = graph(
        [node(CONTROLLER), node("/behaviors"), node(WHEELS, managed=False)],
        [
            topic("/cmd_vel", TWIST, [CONTROLLER, "/behaviors"], [WHEELS]),
            topic("/plan", STRING, [CONTROLLER], [], rate_hz=5),
        ],
    )
    offload, text = imported(seen)
    assert nodes(offload)["controller"].placement == "Duplicated"
    assert nodes(offload)["behaviors"].placement == "Robot"
    assert [it.shared for it in nodes(offload)["controller"].outputs] == [True]
    assert "also published by /behaviors" in text


def test_names_that_the_resource_refuses_are_left_out_and_said() -> None:
    seen = graph(
        [node(CONTROLLER), node(WHEELS, managed=False), node("/bad-name"), node("/naïve\n- evil: true")],
        [
            topic("/cmd_vel", TWIST, [CONTROLLER], [WHEELS]),
            topic("/a__b", STRING, [WHEELS], [CONTROLLER]),
            topic("/c/d", STRING, [WHEELS], [CONTROLLER]),
            topic("/c_", "no type\n: [", [WHEELS], [CONTROLLER]),
        ],
    )
    offload, text = imported(seen)
    assert set(nodes(offload)) == {"controller", "wheels"}
    assert [it.name for it in offload.spec.topics.to_cloud] == ["/c/d"]
    assert "Left out: /a__b" in text
    assert "Left out: bad-name" in text
    assert all(ord(it) < 128 for it in text)


def test_a_topic_and_a_service_of_one_name_leave_one_of_the_two() -> None:
    seen = graph(
        [node(CONTROLLER, services={"/cmd_vel": "std_srvs/srv/Trigger"}), node(WHEELS, managed=False)],
        [topic("/cmd_vel", TWIST, [CONTROLLER], [WHEELS])],
    )
    offload, text = imported(seen)
    assert nodes(offload)["controller"].outputs
    assert not nodes(offload)["controller"].services
    assert "Left out: /cmd_vel" in text


def test_strange_quality_of_service_and_other_middlewares_are_no_hindrance() -> None:
    values = small().model_dump() | {"rmw": "rmw_cyclonedds_cpp", "distro": "rolling", "participant": "zz"}
    values["topics"][0]["publishers"] = [{"node": "/laser"}, {"node": "/gone", "durability": "TransientLocal"}]
    values["nodes"][1]["participants"] = ["not hexadecimal", ""]
    offload, text = imported(GraphSnapshot.model_validate(values))
    assert (offload.spec.robot.rmw, offload.spec.cloud_rmw) == ("rmw_cyclonedds_cpp", "rmw_fastrtps_cpp")
    assert "ROS 2 rolling is not one of" in text


def test_a_graph_of_200_nodes_fits_with_those_that_matter() -> None:
    """Sixty-four nodes fit; those that leave and their neighbours come first."""
    crowd = [node(f"/crowd_{number}", managed=False) for number in range(197)]
    seen = small()
    chatter = [
        topic(f"/crowd/topic_{number}", STRING, [f"/crowd_{number % 197}"], [CONTROLLER]) for number in range(300)
    ]
    large = seen.model_copy(update={"nodes": (*crowd, *seen.nodes), "topics": (*seen.topics, *chatter)})
    offload, text = imported(large)
    assert len(offload.spec.nodes) == 64
    assert "controller" in nodes(offload)
    assert len(offload.spec.topics.to_cloud) == 128
    assert "Not listed: /crowd_99; a RobotOffload has at most 64 nodes" in text
    assert "Left out, at most 128 topics to the cloud" in text


def test_children_of_a_process_belong_to_its_node_and_components_do_not() -> None:
    costmap, speed = "/local_costmap/local_costmap", "/velocity_planner"
    one, two, other = (("010faaaa" + it,) for it in ("0700" + "0" * 12, "0700" + "1" * 12, "0800" + "0" * 12))
    seen = graph(
        [node(CONTROLLER, participants=one), node(costmap, participants=two), node(speed, participants=other),
         node("/planner", participants=other),
         node(WHEELS, managed=False)],
        [topic("/cmd_vel", TWIST, [CONTROLLER], [WHEELS]), topic("/scan", SCAN, [WHEELS], [costmap])],
        [process(7, "/opt/ros/jazzy/lib/nav2_controller/controller_server", "--ros-args", cpu=0.4),
         process(8, "/opt/ros/jazzy/lib/rclcpp_components/component_container", "--ros-args", cpu=0.2)],
        participant="010faaaa0900" + "0" * 12,
    )  # fmt: skip
    offload, text = imported(seen)
    controller, planner = nodes(offload)["controller"], nodes(offload)["planner"]
    assert controller.run is not None
    assert (controller.run.package, controller.run.executable) == ("nav2_controller", "controller_server")
    assert controller.resources.requests["cpu"] == "400m"
    assert [it.name for it in offload.spec.topics.to_cloud] == ["/scan"], "the costmap hears it for the controller"
    assert "with its parts /local_costmap/local_costmap" in text
    assert planner.run is None
    assert planner.resources.requests["cpu"] == "100m"
    assert "a component in component_container" in text


def test_nodes_that_share_a_process_are_listed_and_the_process_is_started_once() -> None:
    pid = ("010faaaa0700" + "0" * 12,)
    seen = graph(
        [node("/amcl", participants=pid), node("/planner", participants=pid)],
        processes=[process(7, "/usr/bin/python3", "stack.py", cpu=0.2)],
        participant="010faaaa0900" + "0" * 12,
    )
    offload, text = imported(seen)
    amcl, planner = nodes(offload)["amcl"], nodes(offload)["planner"]
    assert amcl.run is not None
    assert planner.run is None
    assert amcl.resources.requests["cpu"] == planner.resources.requests["cpu"] == "100m"
    assert "in the process of /amcl" in text


def test_parameters_that_were_given_are_written_and_the_others_listed() -> None:
    text = "/**:\n  ros__parameters: {a: {b: 1.0}}\nother: {ros__parameters: {c: 1}}\n"
    seen = graph(
        [node(CONTROLLER, parameters={"a.b": 1.0, "c": 2, "d": "x", "use_sim_time": False, "e": 5})],
        processes=[process(7, "/usr/bin/python3", "controller.py", "--ros-args", "--params-file", "f.yaml", "-p",
                           "d:=x", folder="/home/robot", parameter_files={"f.yaml": text})],
    )  # fmt: skip
    offload, written_text = imported(seen, folder="/elsewhere")
    run = nodes(offload)["controller"].run
    assert run is not None
    assert run.command == ("python3", "/home/robot/controller.py")
    assert run.parameters == {"a.b": 1.0, "d": "x"}
    assert run.doubles == ("a.b",)
    assert "parameters, defaults as far as the command line shows: c: 2, e: 5" in written_text


def test_services_and_actions_are_internal_served_used_or_mixed() -> None:
    trigger, follow, spin = "std_srvs/srv/Trigger", "nav2_msgs/action/FollowPath", "nav2_msgs/action/Spin"
    seen = graph(
        [
            node(CONTROLLER, services={"/inner": trigger, "/mixed": trigger, "/clear": trigger},
                 clients={"/dock": trigger}, actions={"/follow": follow}),
            node("/planner", clients={"/inner": trigger, "/mixed": trigger}, actions={"/spin": spin}),
            node("/app", managed=False, clients={"/mixed": trigger}, action_clients={"/follow": follow}),
            node("/dock_driver", managed=False, services={"/dock": trigger}),
        ]
    )  # fmt: skip
    found = nodes(imported(seen)[0])
    assert [it.name for it in found["controller"].services] == ["/clear", "/mixed"]
    assert [it.name for it in found["planner"].uses.services] == ["/mixed"]
    assert [it.name for it in found["controller"].uses.services] == ["/dock"]
    assert [(it.name, it.on_switch) for it in found["controller"].actions] == [("/follow", "Continue")]
    assert [(it.name, it.on_switch) for it in found["planner"].actions] == [("/spin", "Abort")]


def test_transforms_of_a_single_publisher_are_frames_and_those_of_several_are_listed() -> None:
    alone = graph(
        [node("/amcl"), node(WHEELS, managed=False)],
        [topic("/tf", "tf2_msgs/msg/TFMessage", ["/amcl"], [WHEELS], frames=(("map", "odom"),))],
    )
    frames = nodes(imported(alone)[0])["amcl"].outputs[0].frames
    assert [(it.parent, it.child) for it in frames] == [("map", "odom")]
    both = graph(
        [node("/amcl"), node(WHEELS, managed=False)],
        [
            topic(
                "/tf",
                "tf2_msgs/msg/TFMessage",
                ["/amcl", WHEELS],
                ["/amcl"],
                frames=(("map", "odom"), ("odom", "base")),
            )
        ],
    )
    offload, text = imported(both)
    assert nodes(offload)["amcl"].outputs[0].shared
    assert "seen: map->odom, odom->base" in text


_NAMES = st.one_of(
    st.sampled_from(["/a", "/b", "/ns/a", "/a_", "/a__b", "/offload/x", "/tf", "/guardian", ""]), st.text(max_size=12)
)
_ENDS = st.lists(st.builds(dict, node=_NAMES), max_size=3)
_KINDS = st.lists(st.sampled_from([TWIST, SCAN, STRING, "x", "\n# "]), max_size=2)
_TOPICS = st.builds(
    dict, name=_NAMES, types=_KINDS, publishers=_ENDS, subscribers=_ENDS, messages=st.integers(0, 10**15),
    size=st.integers(0, 10**15), span_s=st.floats(0, 1e15), measured=st.booleans(), problem=st.text(max_size=8),
)  # fmt: skip
_SERVICES = st.dictionaries(_NAMES, st.sampled_from(["std_srvs/srv/Trigger", "x/action/Y", "?"]), max_size=2)
_NODES = st.builds(
    NodeSeen, name=_NAMES, twice=st.booleans(), lifecycle=st.sampled_from(["", "active", "\n"]), services=_SERVICES,
    clients=_SERVICES, actions=_SERVICES, action_clients=_SERVICES,
    parameters=st.dictionaries(_NAMES, st.text(), max_size=2),
)  # fmt: skip


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(_NODES, max_size=5), st.lists(_TOPICS, max_size=5), st.text(max_size=20), st.text(max_size=8))
def test_whatever_is_seen_the_file_is_valid_or_there_is_a_reason(
    seen: list[NodeSeen], topics: list[dict[str, object]], host: str, rmw: str
) -> None:
    values = {"nodes": [it.model_dump() for it in seen], "topics": topics, "host": host, "rmw": rmw}
    try:
        imported(GraphSnapshot.model_validate(values))
    except SurveyError:
        return
