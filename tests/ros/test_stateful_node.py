"""A node that hands over its state: which snapshots of the other side it takes, with the middleware beneath."""

import struct
import time
from collections.abc import Iterator

import pytest
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from std_msgs.msg import UInt8MultiArray

from robot_offload_state import StatefulNode, pack
from robot_offload_state.node import _KEPT

DOMAIN = 33
PATIENCE_S = 60.0

pytestmark = [
    pytest.mark.ros,
    pytest.mark.filterwarnings("ignore:module 'sre_.*' is deprecated:DeprecationWarning"),
]


class Counter(StatefulNode):
    """Keeps a number."""

    def __init__(self, context: Context) -> None:
        super().__init__("counter", context=context)
        self.number = self.heard = 0

    def _arrived(self, message: UInt8MultiArray) -> None:
        super()._arrived(message)
        self.heard += 1

    def take_state(self, version: int, data: bytes) -> None:
        del version
        (self.number,) = struct.unpack(">I", data)

    def count(self) -> None:
        self.number += 1
        self.publish_state(1, struct.pack(">I", self.number))


class World:
    """A counter, and the agent's end of its snapshots."""

    def __init__(self) -> None:
        self.context = Context()
        rclpy.init(context=self.context, domain_id=DOMAIN)
        self.counter = Counter(self.context)
        self.agent = rclpy.create_node("agent", context=self.context)
        self.restore = self.agent.create_publisher(UInt8MultiArray, "/counter/offload/restore", _KEPT)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.counter)
        self.executor.add_node(self.agent)

    def activate(self) -> None:
        state = LifecycleState("inactive", 2)
        assert self.counter.on_activate(state) is TransitionCallbackReturn.SUCCESS

    def give(self, number: int) -> None:
        """The agent gives a snapshot, and the node has heard it when this returns."""
        self.restore.publish(UInt8MultiArray(data=pack(1, struct.pack(">I", number))))
        heard = self.counter.heard
        deadline_s = time.monotonic() + PATIENCE_S
        while self.counter.heard == heard:
            assert time.monotonic() < deadline_s
            self.executor.spin_once(timeout_sec=0.1)

    def close(self) -> None:
        self.executor.shutdown()
        for node in (self.agent, self.counter):
            node.destroy_node()  # else its latched snapshots reach the next test's counter
        rclpy.shutdown(context=self.context)


@pytest.fixture
def world() -> Iterator[World]:
    made = World()
    yield made
    made.close()


def test_a_sleeping_node_takes_the_newest_when_it_wakes(world: World) -> None:
    world.give(5)
    world.give(6)
    assert world.counter.number == 0
    world.activate()
    assert world.counter.number == 6


def test_a_node_that_began_clean_takes_the_first_that_comes_although_it_has_counted_meanwhile(world: World) -> None:
    world.activate()
    world.counter.count()
    world.give(7)
    assert world.counter.number == 7


def test_a_node_that_knows_the_others_state_and_has_gone_on_takes_nothing_older(world: World) -> None:
    world.give(5)
    world.activate()
    world.give(6)
    assert world.counter.number == 6, "it has not said anything yet"
    world.counter.count()
    world.give(6)
    assert world.counter.number == 7
