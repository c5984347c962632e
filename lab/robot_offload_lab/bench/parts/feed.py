"""A robot's sensors: publishes stamped messages on a number of topics at a rate, each in a phase of its own."""

from __future__ import annotations

import sys
from functools import partial

from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import CompressedImage

from robot_offload_lab.bench.parts import node


class Feed(Node):  # type: ignore[misc]  # rclpy carries no types
    """Parameters: `topics`, `rate_hz`, `payload_bytes` (a list; the sizes take turns in every topic)."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.declare_parameter("topics", ["/bench/input"])
        self.declare_parameter("rate_hz", 20.0)
        self.declare_parameter("payload_bytes", [64])
        self._waiting = list(self.get_parameter("topics").value)
        self._period_s = 1.0 / self.get_parameter("rate_hz").value
        self._stagger = self.create_timer(self._period_s / (len(self._waiting) + 1), self._add)

    def _add(self) -> None:
        """Start the next topic."""
        if not self._waiting:
            self._stagger.cancel()
            return
        topic = self._waiting.pop(0)
        stamped = node.Stamped(topic.strip("/").replace("/", "_"), self.get_parameter("payload_bytes").value)
        publisher = self.create_publisher(CompressedImage, topic, 10)
        self.create_timer(self._period_s, partial(self._publish, publisher, stamped))

    def _publish(self, publisher: Publisher, stamped: node.Stamped) -> None:
        publisher.publish(stamped.next(self.get_clock().now().to_msg()))


if __name__ == "__main__":
    node.start()
    node.spin(Feed(sys.argv[1]))
