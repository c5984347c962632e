"""The cloud's end of the rivals: one publisher for each, every one on a thread and a period of its own.

`python -m robot_offload_lab.bench.parts.rival_sender --period SECONDS` (the period of the product's heartbeats, for
the one that has none of its own).
"""

from __future__ import annotations

import argparse
import threading
import time
from typing import Final

import rclpy
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import LivelinessPolicy, QoSProfile
from std_msgs.msg import Header

from robot_offload_lab.bench.parts import node
from robot_offload_lab.bench.rivals import LIVELINESS, MESSAGE, RIVALS, Rival
from robot_offload_lab.wire.loop import steady_s

DEPTH: Final = 10


def quality(rival: Rival) -> QoSProfile:
    """Return the arguments of both ends of a rival's topic."""
    if rival is LIVELINESS:
        assert rival.patience_s is not None
        return QoSProfile(
            depth=1,
            liveliness=LivelinessPolicy.MANUAL_BY_TOPIC,
            liveliness_lease_duration=Duration(seconds=rival.patience_s),
        )
    return QoSProfile(depth=DEPTH if rival is MESSAGE else 1)


def publish(sender: Node, rival: Rival, period_s: float) -> None:
    """Publish forever; a message asserts the liveliness, too."""
    publisher, message = sender.create_publisher(Header, rival.name, quality(rival)), Header()
    due_s = steady_s()
    while True:
        message.stamp = sender.get_clock().now().to_msg()
        publisher.publish(message)
        due_s += period_s
        time.sleep(max(0.0, due_s - steady_s()))


def main() -> None:
    """Publish until SIGTERM."""
    parser = argparse.ArgumentParser(prog="python -m robot_offload_lab.bench.parts.rival_sender", description=__doc__)
    parser.add_argument("--period", type=float, required=True, help="seconds")
    options = parser.parse_args()
    node.start()
    sender = rclpy.create_node("rival_sender")
    for rival in RIVALS:
        period_s = rival.period_s or options.period
        threading.Thread(target=publish, args=(sender, rival, period_s), name=rival.name, daemon=True).start()
    threading.Event().wait()


if __name__ == "__main__":
    main()
