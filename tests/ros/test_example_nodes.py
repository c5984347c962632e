"""The example nodes as real processes: they start, obey their lifecycle, and end cleanly."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import rclpy
from geometry_msgs.msg import TwistStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import String
from std_srvs.srv import SetBool

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
WHEELCHAIR_DOMAIN = 31
TALKER_DOMAIN = 32
PATIENCE_S = 60.0

pytestmark = [
    pytest.mark.ros,
    # The first use of a message type imports the wheels' old parser, which says so.
    pytest.mark.filterwarnings("ignore:module 'sre_.*' is deprecated:DeprecationWarning"),
]


class Processes:
    """Starts example scripts and ends them, whatever happened."""

    def __init__(self, folder: Path, domain: int) -> None:
        self._folder = folder
        self._env = dict(os.environ, ROS_DOMAIN_ID=str(domain), ROS_LOG_DIR=str(folder))
        self._running: dict[str, subprocess.Popen[bytes]] = {}

    def start(self, script: str, *ros_args: str) -> str:
        """Starts `examples/<script>`; returns the name by which to stop it."""
        name = f"{Path(script).stem}-{len(self._running)}"
        command = [sys.executable, str(EXAMPLES / script), "--ros-args", *ros_args]
        with self._path(name).open("wb") as output:
            self._running[name] = subprocess.Popen(
                command, env=self._env, stdout=output, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL
            )
        return name

    def stop(self, name: str, number: signal.Signals) -> int:
        """Sends one signal and returns the exit code."""
        self._running[name].send_signal(number)
        return self._running[name].wait(PATIENCE_S)

    def output(self, name: str) -> str:
        return self._path(name).read_text()

    def close(self) -> None:
        for process in self._running.values():
            process.kill()
            process.wait(PATIENCE_S)

    def _path(self, name: str) -> Path:
        return self._folder / f"{name}.log"


class Observer:
    """A node of the test in one domain."""

    def __init__(self, domain: int) -> None:
        self._context = Context()
        rclpy.init(context=self._context, domain_id=domain)
        self.node = Node("observer", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)

    def record(self, message_type: Any, topic: str) -> list[Any]:
        """A list that grows with every message of the topic."""
        heard: list[Any] = []
        self.node.create_subscription(message_type, topic, heard.append, 200)
        return heard

    def until(self, condition: Callable[[], bool], patience_s: float = PATIENCE_S) -> bool:
        """Spins until the condition holds or patience ends; says whether it held."""
        end_s = time.monotonic() + patience_s
        while not condition():
            if time.monotonic() > end_s:
                return False
            self._executor.spin_once(timeout_sec=0.05)
        return True

    def spin(self, seconds: float) -> None:
        self.until(lambda: False, seconds)

    def call(self, service_type: Any, name: str, request: Any) -> Any:
        client = self.node.create_client(service_type, name)
        assert self.until(client.service_is_ready), f"no service {name}"
        future = client.call_async(request)
        assert self.until(future.done), f"no answer of {name}"
        self.node.destroy_client(client)
        return future.result()

    def change_state(self, node: str, transition: int) -> None:
        request = ChangeState.Request(transition=Transition(id=transition))
        assert self.call(ChangeState, f"/{node}/change_state", request).success

    def close(self) -> None:
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self._context)


@pytest.fixture
def wheelchair(tmp_path: Path) -> Iterator[tuple[Processes, Observer]]:
    yield from _set_up(tmp_path, WHEELCHAIR_DOMAIN)


@pytest.fixture
def talker(tmp_path: Path) -> Iterator[tuple[Processes, Observer]]:
    yield from _set_up(tmp_path, TALKER_DOMAIN)


def _set_up(folder: Path, domain: int) -> Iterator[tuple[Processes, Observer]]:
    processes, observer = Processes(folder, domain), Observer(domain)
    try:
        yield processes, observer
    finally:
        observer.close()  # before others are killed, see harness.World.close
        processes.close()


def assert_without_holes(commands: list[Any], node: str) -> None:
    """Every command names its sender and the next number."""
    first = int(commands[0].header.frame_id.partition("#")[2])
    expected = [f"{node}#{first + i}" for i in range(len(commands))]
    assert [command.header.frame_id for command in commands] == expected


def test_the_wheelchair_drives_while_its_controller_is_active_and_brakes_without_it(
    wheelchair: tuple[Processes, Observer], tmp_path: Path
) -> None:
    processes, observer = wheelchair
    states, commands = observer.record(String, "/wheelchair/state"), observer.record(TwistStamped, "/cmd_vel")
    log_file = tmp_path / "path.jsonl"
    processes.start("wheelchair/wheelchair.py", "-p", "seed:=3", "-p", f"log_file:={log_file}")
    processes.start("wheelchair/controller.py")

    def state() -> dict[str, Any]:
        decoded: dict[str, Any] = json.loads(states[-1].data)
        return decoded

    observer.change_state("controller", Transition.TRANSITION_CONFIGURE)
    assert observer.until(lambda: len(states) > 0)
    observer.spin(1.0)
    assert commands == []  # Inactive: the timer runs, nothing is said
    assert state()["t_s"] == 0.0  # the run waits for the first command

    observer.change_state("controller", Transition.TRANSITION_ACTIVATE)
    assert observer.until(lambda: state()["x"] > 1.5)
    assert 0.0 < state()["speed"] <= 0.61

    observer.change_state("controller", Transition.TRANSITION_DEACTIVATE)
    assert observer.until(lambda: bool(state()["stops"] == 1))
    assert state()["speed"] < 0.01
    assert_without_holes(commands, "controller")

    observer.change_state("controller", Transition.TRANSITION_ACTIVATE)
    assert observer.until(lambda: state()["speed"] > 0.2)
    assert state()["collisions"] == 0
    lines = [json.loads(line) for line in log_file.read_text().splitlines()]
    assert [line["t_s"] for line in lines] == sorted({line["t_s"] for line in lines})
    assert lines[-1]["corridor"] == {"length": 46.0, "width": 2.4}


def test_the_inhibit_service_brakes_and_releases(wheelchair: tuple[Processes, Observer]) -> None:
    processes, observer = wheelchair
    states = observer.record(String, "/wheelchair/state")
    processes.start("wheelchair/wheelchair.py")
    processes.start("wheelchair/controller.py", "-p", "autostart:=true")

    def state() -> dict[str, Any]:
        decoded: dict[str, Any] = json.loads(states[-1].data) if states else {"speed": 0.0, "stops": 0}
        return decoded

    assert observer.until(lambda: state()["speed"] > 0.2)
    assert observer.call(SetBool, "/wheels_control/inhibit", SetBool.Request(data=True)).success
    assert observer.until(lambda: bool(state()["stops"] == 1))
    assert state()["inhibited"]
    observer.spin(0.5)
    assert state()["speed"] == 0.0

    assert observer.call(SetBool, "/wheels_control/inhibit", SetBool.Request(data=False)).success
    assert observer.until(lambda: state()["speed"] > 0.2)


def test_the_passengers_goal_is_reached_where_the_localiser_says_that_it_is(
    wheelchair: tuple[Processes, Observer],
) -> None:
    processes, observer = wheelchair
    accounts = observer.record(String, "/passenger/account")
    began = observer.record(String, "/localiser/account")
    states = observer.record(String, "/wheelchair/state")
    processes.start("wheelchair/wheelchair.py", "-p", "odom_drift:=0.2", "-p", "announce_goal:=false")
    processes.start("wheelchair/localiser.py")
    processes.start("wheelchair/controller.py", "-r", "odom:=/pose")
    for node in ("localiser", "controller"):
        for transition in (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE):
            observer.change_state(node, transition)
    assert observer.until(lambda: bool(began))
    said = json.loads(began[-1].data)
    assert (said["node"], said["restored_age_s"]) == ("localiser", None)
    processes.start("wheelchair/passenger.py", "-p", "goals_m:=[4.0, 4.5]")

    def goals() -> list[dict[str, Any]]:
        found: list[dict[str, Any]] = json.loads(accounts[-1].data)["goals"] if accounts else []
        return found

    assert observer.until(lambda: [goal["ending"] for goal in goals()] == ["succeeded"] * 2)
    assert [(goal["results"], goal["servers"], goal["backwards"]) for goal in goals()] == [(1, 1, 0)] * 2
    assert all(goal["accepted_ms"] is not None and goal["feedback"] > 0 for goal in goals())
    assert json.loads(accounts[-1].data)["calls"]["answered"] > 0
    # Odometry alone would be wrong by 0.7 m here; the marker at 3 m has said so.
    assert abs(json.loads(states[-1].data)["x"] - goals()[-1]["x_m"]) < 0.45


def test_a_replica_runs_under_another_name_and_topic_and_can_be_configured_again(
    wheelchair: tuple[Processes, Observer],
) -> None:
    processes, observer = wheelchair
    commands = observer.record(TwistStamped, "/offload/cloud/cmd_vel")
    public = observer.record(TwistStamped, "/cmd_vel")
    processes.start("wheelchair/wheelchair.py")
    remap = ("-r", "controller:__node:=remote_controller", "-r", "/cmd_vel:=/offload/cloud/cmd_vel")
    processes.start("wheelchair/controller.py", *remap, "-p", "rate_hz:=50.0", "-p", "max_speed:=0.9")

    for transition in (
        Transition.TRANSITION_CONFIGURE,
        Transition.TRANSITION_CLEANUP,
        Transition.TRANSITION_CONFIGURE,
        Transition.TRANSITION_ACTIVATE,
    ):
        observer.change_state("remote_controller", transition)

    assert observer.until(lambda: len(commands) >= 20)
    assert_without_holes(commands, "remote_controller")
    assert public == []


def test_a_controller_whose_scans_stop_commands_a_standstill(
    wheelchair: tuple[Processes, Observer],
) -> None:
    processes, observer = wheelchair
    commands = observer.record(TwistStamped, "/cmd_vel")
    base = processes.start("wheelchair/wheelchair.py")
    processes.start("wheelchair/controller.py", "-p", "autostart:=true")
    assert observer.until(lambda: bool(commands) and commands[-1].twist.linear.x > 0.2)

    processes.stop(base, signal.SIGKILL)

    assert observer.until(lambda: bool(commands[-1].twist.linear.x == 0.0))


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_every_example_node_ends_cleanly_on_a_signal(
    talker: tuple[Processes, Observer], number: signal.Signals
) -> None:
    processes, observer = talker
    scripts = {
        "wheelchair_base": "wheelchair/wheelchair.py",
        "controller": "wheelchair/controller.py",
        "localiser": "wheelchair/localiser.py",
        "passenger": "wheelchair/passenger.py",
        "talker": "talker/talker.py",
        "listener": "talker/listener.py",
    }
    names = [processes.start(script) for script in scripts.values()]
    assert observer.until(lambda: set(scripts) <= set(observer.node.get_node_names()))
    observer.spin(1.0)

    assert [processes.stop(name, number) for name in names] == [0] * len(names)
    assert [processes.output(name) for name in names] == [""] * len(names)


def test_the_listener_prints_what_an_active_talker_says(talker: tuple[Processes, Observer]) -> None:
    processes, observer = talker
    listener = processes.start("talker/listener.py")
    processes.start("talker/talker.py", "-r", "talker:__node:=remote_talker", "-p", "rate_hz:=20.0")
    observer.change_state("remote_talker", Transition.TRANSITION_CONFIGURE)
    observer.spin(1.0)
    assert processes.output(listener) == ""

    observer.change_state("remote_talker", Transition.TRANSITION_ACTIVATE)

    assert observer.until(lambda: processes.output(listener).count("\n") >= 5)
    numbers = [int(line.split()[1]) for line in processes.output(listener).splitlines()]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    assert processes.output(listener).splitlines()[0].endswith("from remote_talker")
