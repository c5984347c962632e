"""A stock rclpy node that stands still for seconds is asked for each transition once, and lives."""

from __future__ import annotations

import queue
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import rclpy
import yaml
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode

from robot_offload_agent.ros import managed_nodes as shell
from robot_offload_agent.ros.managed_nodes import ManagedNodes
from robot_offload_agent.settings.parameters import Configuration, load
from robot_offload_core.control.nodes import guardians
from robot_offload_core.control.nodes.managed_nodes import Answered, ChangeState, GetState, Observed, Transition
from robot_offload_core.words.lifecycle import State
from tests.ros.agent.ears import Ear

pytestmark = [pytest.mark.ros, pytest.mark.core]

DOMAIN = 72
PATIENCE_S = 60.0
NAME = "walker"


class Walker:
    """A lifecycle node that is spun only when the test says so: in between it stands still."""

    def __init__(self) -> None:
        self.context = Context()
        rclpy.init(context=self.context, domain_id=DOMAIN)
        self.node = LifecycleNode(NAME, context=self.context, enable_rosout=False, start_parameter_services=False)
        self.node.trigger_configure()
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)

    def wake(self, for_s: float = 0.5) -> None:
        """Take all that has arrived; what a callback raises comes out here, and would end the node's process."""
        end_s = time.monotonic() + for_s
        while time.monotonic() < end_s:
            self.executor.spin_once(timeout_sec=0.05)

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


class Asking:
    """The agent's shell with what it has reported."""

    def __init__(self, configuration: Configuration) -> None:
        self.heard: queue.Queue[guardians.Event] = queue.Queue()
        self.ear = Ear(DOMAIN, "agent")
        self.nodes = ManagedNodes(configuration, self.ear.node, self.heard.put)

    def ask(self, transition: Transition) -> None:
        self.nodes.carry_out(ChangeState(NAME, transition, 2.0))

    def reported(self) -> list[guardians.Event]:
        found = []
        while not self.heard.empty():
            found.append(self.heard.get())
        return found

    def until(self, holds: Callable[[], bool], meanwhile: Callable[[], None] = lambda: time.sleep(0.01)) -> None:
        end_s = time.monotonic() + PATIENCE_S
        while not holds():
            assert time.monotonic() < end_s
            meanwhile()


@pytest.fixture
def walker() -> Iterator[Walker]:
    made = Walker()
    yield made
    made.close()


@pytest.fixture
def asking(tmp_path: Path, walker: Walker) -> Iterator[Asking]:
    given = {"side": "robot", "uid": "walker-1", "link": {"type": "ros"}, "nodes": [NAME]}
    file = tmp_path / "robot.yaml"
    file.write_text(yaml.safe_dump({"/**": {"ros__parameters": given}}))
    made = Asking(load(file))
    made.until(made.nodes.change[NAME].service_is_ready, walker.wake)
    made.until(made.nodes.read[NAME].service_is_ready, walker.wake)
    yield made
    made.ear.close()


def test_a_request_that_is_repeated_while_the_node_stands_still_reaches_it_once(walker: Walker, asking: Asking) -> None:
    for _ in range(3):
        asking.ask(Transition.ACTIVATE)
        time.sleep(0.1)
    asking.until(lambda: walker.node._state_machine.current_state[1] == "active", walker.wake)
    walker.wake(1.0)  # a second request would raise RCLError here
    asking.until(lambda: Answered(NAME, Transition.ACTIVATE, True) in asking.reported(), walker.wake)
    asking.ask(Transition.DEACTIVATE)
    asking.until(lambda: walker.node._state_machine.current_state[1] == "inactive", walker.wake)


def test_a_request_that_was_lost_is_repeated_after_a_while(
    walker: Walker, asking: Asking, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shell, "UNANSWERED_S", 0.0)
    asking.ask(Transition.ACTIVATE)
    asking.ask(Transition.DEACTIVATE)  # behind the first: the node carries out both
    asking.until(lambda: Observed(NAME, State.ACTIVE) in asking.reported(), walker.wake)
    asking.until(lambda: walker.node._state_machine.current_state[1] == "inactive", walker.wake)


def test_a_read_that_was_overtaken_by_a_report_of_the_node_gives_the_newer_state(
    walker: Walker, asking: Asking
) -> None:
    asking.nodes.carry_out(GetState(NAME, 1.0))
    asking.nodes._know(NAME, State.ACTIVE)  # as its transition event does, on another topic
    asking.until(lambda: not asking.heard.empty(), walker.wake)
    assert asking.reported() == [Observed(NAME, State.ACTIVE)]
    asking.nodes.carry_out(GetState(NAME, 1.0))
    asking.until(lambda: not asking.heard.empty(), walker.wake)
    assert asking.reported() == [Observed(NAME, State.INACTIVE)]
