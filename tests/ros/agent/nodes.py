"""A user's lifecycle node for the tests: while it is Active it publishes `producer.PID#sequence` with a stamp.

    python nodes.py --ros-args -r walker:__node:=remote_walker -r /command:=/offload/cloud/command -p rate_hz:=25.0

An ordinary node that knows nothing of the agents: its timer runs in every state, publishing is what the state gates.
With `serves` it also serves the action `/count` and the service `/ask`, as Nav2's servers do, see `counting.py`.
Parameters that can be set while it runs: `activation_s` (how long on_activate takes) and `refuse` (on_activate fails).
"""

import contextlib
import os
import sys
import time

import rclpy
from counting import Counting  # beside this file, which is run by its path
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node
from std_msgs.msg import Header

HEEDED_S = 0.3
"""With `heeds`, a topic, there is nothing to publish when nothing has come there for so long."""


class Walker(LifecycleNode):  # type: ignore[misc]
    """Publishes `/command`, and `extra_topic` when one is given."""

    def __init__(self) -> None:
        super().__init__("walker", enable_rosout=False)
        self.declare_parameter("rate_hz", 20.0)
        self.declare_parameter("activation_s", 0.0)
        self.declare_parameter("refuse", False)
        self.declare_parameter("extra_topic", "")
        self.declare_parameter("padding", 0)
        self.declare_parameter("serves", False)
        self.declare_parameter("silent_when_idle", False)
        self.declare_parameter("heeds", "")
        self.heeded_s = -HEEDED_S
        heeds = self.get_parameter("heeds").value
        self.heeded = self.create_subscription(Header, heeds, self.heed, 10) if heeds else None
        self.counting = Counting(self) if self.get_parameter("serves").value else None
        self.sequence = 0
        self.producer = f"{self.get_name()}.{os.getpid()}" + "." * self.get_parameter("padding").value
        self.command = self.create_lifecycle_publisher(Header, "/command", 10)
        extra = self.get_parameter("extra_topic").value
        self.extra = self.create_publisher(Header, extra, 10) if extra else None
        self.create_timer(1.0 / self.get_parameter("rate_hz").value, self.tell)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        time.sleep(self.get_parameter("activation_s").value)
        if self.get_parameter("refuse").value:
            return TransitionCallbackReturn.FAILURE
        if self.counting is not None:
            self.counting.activate()
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        if self.counting is not None:
            self.counting.deactivate()
        return super().on_deactivate(state)

    def heed(self, _message: Header) -> None:
        self.heeded_s = time.monotonic()

    def tell(self) -> None:
        idle = self.counting is not None and not self.counting.running()
        unasked = self.heeded is not None and time.monotonic() - self.heeded_s > HEEDED_S
        if not self.command.is_activated or unasked or (idle and self.get_parameter("silent_when_idle").value):
            return
        self.sequence += 1
        stamp = self.get_clock().now().to_msg()
        self.command.publish(Header(stamp=stamp, frame_id=f"{self.producer}#{self.sequence}"))


class PlainWalker(Node):  # type: ignore[misc]
    """Publishes `/command` from its start on: a node without a lifecycle."""

    def __init__(self) -> None:
        super().__init__("walker", enable_rosout=False)
        self.declare_parameter("rate_hz", 20.0)
        self.sequence = 0
        self.producer = f"{self.get_name()}.{os.getpid()}"
        self.command = self.create_publisher(Header, "/command", 10)
        self.create_timer(1.0 / self.get_parameter("rate_hz").value, self.tell)

    def tell(self) -> None:
        self.sequence += 1
        stamp = self.get_clock().now().to_msg()
        self.command.publish(Header(stamp=stamp, frame_id=f"{self.producer}#{self.sequence}"))


def main() -> None:
    rclpy.init()
    executor = SingleThreadedExecutor()
    executor.add_node(PlainWalker() if "--plain" in sys.argv else Walker())
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        executor.spin()


if __name__ == "__main__":
    main()
