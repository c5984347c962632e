"""A lifecycle node with state: its replica goes on counting where it was. Run by its path, as a user's node is.

While it is Active it publishes `producer.PID#count` on /command, and its count as state.
"""

import contextlib
import os
import struct
import sys
from pathlib import Path

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from std_msgs.msg import Header

sys.path.insert(0, str(Path(__file__).parents[3] / "state"))
from robot_offload_state import StatefulNode

COUNT = struct.Struct("<Q")


class Remembering(StatefulNode):
    """See the module."""

    def __init__(self) -> None:
        super().__init__("walker", enable_rosout=False)
        rate_hz = self.declare_parameter("rate_hz", 20.0).value
        self.count = 0
        self.command = self.create_lifecycle_publisher(Header, "/command", 10)
        self.create_timer(1.0 / rate_hz, self.tell)

    def take_state(self, version: int, data: bytes) -> None:
        if version != 1 or len(data) != COUNT.size:
            raise ValueError("another format")
        (self.count,) = COUNT.unpack(data)

    def tell(self) -> None:
        if not self.command.is_activated:
            return
        self.count += 1
        stamp = self.get_clock().now().to_msg()
        self.command.publish(Header(stamp=stamp, frame_id=f"{self.get_name()}.{os.getpid()}#{self.count}"))
        self.publish_state(1, COUNT.pack(self.count))


def main() -> None:
    rclpy.init()
    executor = SingleThreadedExecutor()
    executor.add_node(Remembering())
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        executor.spin()


if __name__ == "__main__":
    main()
