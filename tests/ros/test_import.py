"""`robot-offload import` beside the running wheelchair: what it writes is what the example's own file says."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import rclpy
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import String

from robot_offload.api.files import load
from robot_offload.survey.asked import PROGRAM
from robot_offload_lab.run.showcase import showcase

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "wheelchair"
SEDIA = EXAMPLE.parent / "sedia"
DOMAIN = 33
PATIENCE_S = 60.0
SCRIPTS = (
    ("wheelchair.py", "-p", "seed:=1", "-p", "corridor_length:=42.0", "-p", "announce_goal:=false"),
    ("passenger.py", "-p", "goals_m:=[40.5]"),
    ("localiser.py",),
    ("controller.py", "-r", "odom:=/pose", "-p", "rate_hz:=20.0", "-p", "max_speed:=0.6"),
)

PATROL = ("-p", "waypoint_follower:waypoints:=[2.0, 1.0, 10.0, 1.0]", "-p", "detector:layers:=4")

pytestmark = [
    pytest.mark.ros,
    pytest.mark.filterwarnings("ignore:module 'sre_.*' is deprecated:DeprecationWarning"),
]


@pytest.fixture
def environment(tmp_path: Path) -> Iterator[dict[str, str]]:
    """The four nodes of the wheelchair, Active, without agents."""
    found = dict(os.environ, ROS_DOMAIN_ID=str(DOMAIN), ROS_LOG_DIR=str(tmp_path))
    commands = [[sys.executable, script, "--ros-args", *words] for script, *words in SCRIPTS]
    with started(commands, EXAMPLE, found):
        activate("localiser", "controller")
        yield found


@pytest.fixture
def whole_robot(tmp_path: Path) -> Iterator[dict[str, str]]:
    """The 22 nodes of sedia, Active and on the way, in the processes of its demo, without agents."""
    from robot_offload_lab.run import interfaces

    said = showcase(SEDIA / "robotoffload.yaml")
    made = [interfaces.cached(interfaces.read(SEDIA / name)) for name in said.interfaces]
    found = dict(os.environ, ROS_DOMAIN_ID=str(DOMAIN), ROS_LOG_DIR=str(tmp_path)) | interfaces.environment(*made)
    commands = [[sys.executable, "sedia.py", *it.nodes, "--ros-args", *PATROL] for it in said.processes]
    with started(commands, SEDIA, found):
        activate(*(name for it in said.processes for name in it.nodes))
        yield found


@contextmanager
def started(commands: list[list[str]], folder: Path, environment: dict[str, str]) -> Iterator[None]:
    running = [
        subprocess.Popen(it, cwd=folder, env=environment, stdin=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        for it in commands
    ]
    try:
        yield
    finally:
        for process in running:
            process.kill()
            process.wait(PATIENCE_S)


def activate(*names: str) -> None:
    context = Context()
    rclpy.init(args=[], context=context, domain_id=DOMAIN)
    node = Node("_activating", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    try:
        for name in names:
            client = node.create_client(ChangeState, f"/{name}/change_state")
            assert client.wait_for_service(PATIENCE_S), f"{name} did not start"
            for step in (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE):
                future = client.call_async(ChangeState.Request(transition=Transition(id=step)))
                executor.spin_until_future_complete(future, PATIENCE_S)
                assert future.done()
                assert future.result().success
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.shutdown(context=context)


def test_a_running_wheelchair_is_imported_as_its_own_file_describes_it(
    environment: dict[str, str], tmp_path: Path
) -> None:
    file = tmp_path / "robot.yaml"
    command = [
        sys.executable,
        "-m",
        "robot_offload",
        "import",
        "--seconds",
        "8",
        "--name",
        "wheelchair",
        "-o",
        str(file),
    ]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=180, check=False)
    assert done.returncode == 0, done.stderr
    found, own = load(file).spec, load(EXAMPLE / "robotoffload.yaml").spec
    assert {it.name: (it.placement, it.lifecycle) for it in found.nodes} == {
        it.name: (it.placement, it.lifecycle) for it in own.nodes
    }
    assert {it.name for it in found.topics.to_cloud} == {it.name for it in own.topics.to_cloud}
    assert found.driver == own.driver
    assert found.robot.domain_id == DOMAIN
    mine, theirs = (next(it for it in spec.nodes if it.name == "controller") for spec in (found, own))
    assert mine.core
    assert [(it.topic, it.type) for it in mine.outputs] == [(it.topic, it.type) for it in theirs.outputs]
    assert mine.outputs[0].rate_hz, "its rate was measured"
    assert [(it.name, it.type) for it in mine.offered] == [(it.name, it.type) for it in theirs.offered]
    assert mine.run is not None
    assert mine.run.command == ("python3", str(EXAMPLE / "controller.py")), "its process was found"
    assert mine.run.parameters == {"max_speed": 0.6, "rate_hz": 20.0}
    text = file.read_text()
    assert "MiB" in text, "and so were its memory and CPU"
    assert "it moves the robot" in text


def test_a_topic_that_appears_while_we_look_is_measured(tmp_path: Path) -> None:
    looking = subprocess.Popen(
        [sys.executable, str(PROGRAM), "6"],
        env=dict(os.environ, ROS_DOMAIN_ID=str(DOMAIN), ROS_LOG_DIR=str(tmp_path)),
        stdout=subprocess.PIPE,
        text=True,
    )
    context = Context()
    rclpy.init(args=[], context=context, domain_id=DOMAIN)
    node = Node("late", context=context)
    try:
        end_s = time.monotonic() + PATIENCE_S
        while "_robot_offload_import" not in node.get_node_names():
            assert time.monotonic() < end_s, "the program that looks did not start"
            time.sleep(0.05)
        publisher = node.create_publisher(String, "/late_topic", 10)
        while looking.poll() is None:
            publisher.publish(String(data="late"))
            time.sleep(0.05)
    finally:
        node.destroy_node()
        rclpy.shutdown(context=context)
        seen = json.loads(looking.communicate()[0])
    found = next(it for it in seen["topics"] if it["name"] == "/late_topic")
    assert found["measured"]
    assert found["messages"] > 2


@pytest.mark.timeout(300)  # the first time its interface packages are made
def test_the_proposal_for_the_running_whole_robot_keeps_the_hardware_and_moves_the_navigation_stack(
    whole_robot: dict[str, str], tmp_path: Path
) -> None:
    file = tmp_path / "sedia.yaml"
    done = subprocess.run(
        [
            sys.executable, "-m", "robot_offload", "import", "--seconds", "8", "--name", "sedia", "-o", str(file),
        ],
        env=whole_robot, capture_output=True, text=True, timeout=180, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found, own = load(file).spec, load(SEDIA / "robotoffload.yaml").spec
    placed = {it.name: it.placement for it in found.nodes}
    assert all(it.lifecycle for it in found.nodes)
    assert placed.keys() == {it.name for it in own.nodes}
    # Who wants something of the robot, or works on what others sense, could leave: only a person knows better.
    could = {"hmi", "waypoint_follower", "pointcloud_to_laserscan"}
    stays = {it.name for it in own.nodes if it.placement == "Robot"} - could
    assert {name for name in stays if placed[name] != "Robot"} == set()
    moves = {it.name for it in own.nodes if it.duplicated}
    assert {name for name in moves if placed[name] != "Duplicated"} == set()
    assert {it.name for it in found.nodes if it.core} == {"controller_server", "behavior_server"}
    assert found.driver == own.driver
    assert "controller_server" in done.stdout, "the line that names what can leave the robot"
    assert "frames" in file.read_text(), "two nodes publish on /tf, one of them leaves"
