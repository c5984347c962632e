"""Ten publishers in one process, one for each type of `kinds`, at 10 Hz, each in a phase of its own."""

from __future__ import annotations

import importlib
import itertools
from functools import partial
from typing import Any, Final

from rclpy.node import Node

from robot_offload_lab.bench.kinds import KINDS, RATE_HZ
from robot_offload_lab.bench.parts import node

BEAMS: Final = 720
JOINTS: Final = 6


class Source(Node):  # type: ignore[misc]  # rclpy carries no types
    """Publishes; every message carries its time and `KIND#NUMBER`."""

    def __init__(self) -> None:
        super().__init__("kinds")
        self._waiting = list(KINDS)
        self._stagger = self.create_timer(1.0 / RATE_HZ / len(KINDS), self._add)

    def _add(self) -> None:
        """Start the next publisher."""
        if not self._waiting:
            self._stagger.cancel()
            return
        kind = self._waiting.pop(0)
        message = filled(kind.name, message_class(kind.type))
        publisher = self.create_publisher(type(message), kind.sent, 10)
        self.create_timer(1.0 / RATE_HZ, partial(self._publish, publisher, message, kind.name, itertools.count(1)))

    def _publish(self, publisher: Any, message: Any, name: str, numbers: itertools.count[int]) -> None:
        message.header.frame_id = f"{name}#{next(numbers)}"
        message.header.stamp = self.get_clock().now().to_msg()
        publisher.publish(message)


def message_class(type_name: str) -> Any:
    """Return the class of `package/msg/Type`."""
    package, _, short = type_name.partition("/msg/")
    return getattr(importlib.import_module(f"{package}.msg"), short)


def filled(name: str, kind: Any) -> Any:
    """Return a message of the size that a robot's has: ranges in a scan, a robot arm's joints."""
    message = kind()
    if name == "scan":
        message.ranges = [1.0] * BEAMS
        message.intensities = [1.0] * BEAMS
    if name == "joints":
        message.name = [f"joint_{number}" for number in range(JOINTS)]
        message.position = message.velocity = message.effort = [0.0] * JOINTS
    return message


if __name__ == "__main__":
    node.start()
    node.spin(Source())
