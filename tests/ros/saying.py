"""A node that says its name on one topic, and prints each name that it hears on another: NAME SAYS HEARS."""

from __future__ import annotations

import sys

import rclpy
from std_msgs.msg import String

PERIOD_S = 0.1


def main(name: str, says: str, hears: str) -> None:
    """Spins until the process is ended."""
    rclpy.init()
    node = rclpy.create_node(name)
    publisher = node.create_publisher(String, says, 10)
    heard: set[str] = set()

    def hear(message: String) -> None:
        if message.data not in heard:
            heard.add(message.data)
            print(f"heard {message.data}", flush=True)  # noqa: T201

    node.create_subscription(String, hears, hear, 10)
    node.create_timer(PERIOD_S, lambda: publisher.publish(String(data=name)))
    rclpy.spin(node)


if __name__ == "__main__":
    main(*sys.argv[1:])
