"""A lifecycle node with state: its replica goes on counting where it was. Run by its path, as a user's node is.

While it is Active it publishes `producer.PID#count` on /command, and its count as state; and on /lap, a topic that is
state too, how far it has come: `PACE PID#lap`. It goes on from what it hears on the private name of /set_lap. PACE is
the parameter `pace` as it was at the start, or as it was set while the node was Active: it listens only then. At the
pace `silent` it says nothing of its state. With `serves` it serves the actions and services of `counting.py`.
"""

import contextlib
import os
import struct
import sys
from pathlib import Path

import rclpy
from counting import Counting  # beside this file, which is run by its path
from rcl_interfaces.msg import SetParametersResult
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from std_msgs.msg import Header, String

sys.path.insert(0, str(Path(__file__).parents[3] / "state"))
from robot_offload_state import StatefulNode

COUNT = struct.Struct("<Q")


class Remembering(StatefulNode):
    """See the module."""

    def __init__(self) -> None:
        super().__init__("walker", enable_rosout=False)
        rate_hz = self.declare_parameter("rate_hz", 20.0).value
        self.counting = Counting(self) if self.declare_parameter("serves", False).value else None
        self.count = 0
        self.pace = self.declare_parameter("pace", "slow").value
        self.add_on_set_parameters_callback(self.judge)
        self.command = self.create_lifecycle_publisher(Header, "/command", 10)
        self.lap = 0
        self.laps = self.create_lifecycle_publisher(String, "/lap", 10)
        self.side = self.resolve_topic_name("/command").split("/")[2]
        self.create_subscription(String, f"/offload/{self.side}/set_lap", self.set_lap, 10)
        self.create_timer(1.0 / rate_hz, self.tell)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        self.add_on_set_parameters_callback(self.set_pace)
        if self.counting is not None:
            self.counting.activate()
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        self.remove_on_set_parameters_callback(self.set_pace)
        if self.counting is not None:
            self.counting.deactivate()
        return super().on_deactivate(state)

    def set_pace(self, changed: list[Parameter]) -> SetParametersResult:
        self.pace = next((each.value for each in changed if each.name == "pace"), self.pace)
        return SetParametersResult(successful=True)

    def judge(self, changed: list[Parameter]) -> SetParametersResult:
        allowed = self.side == "robot" or all(each.value != "robot only" for each in changed)
        return SetParametersResult(successful=allowed, reason="too fast")

    def take_state(self, version: int, data: bytes) -> None:
        if version != 1 or len(data) != COUNT.size:
            raise ValueError("another format")
        (self.count,) = COUNT.unpack(data)

    def set_lap(self, said: String) -> None:
        self.lap = int(said.data.partition("#")[2])

    def tell(self) -> None:
        if not self.command.is_activated:
            return
        self.count += 1
        stamp = self.get_clock().now().to_msg()
        self.command.publish(Header(stamp=stamp, frame_id=f"{self.get_name()}.{os.getpid()}#{self.count}"))
        if self.pace != "silent":
            self.publish_state(1, COUNT.pack(self.count))
        self.lap += 1
        self.laps.publish(String(data=f"{self.pace} {os.getpid()}#{self.lap}"))


def main() -> None:
    rclpy.init()
    executor = SingleThreadedExecutor()
    executor.add_node(Remembering())
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        executor.spin()


if __name__ == "__main__":
    main()
