#!/usr/bin/env python3
"""ROS node `listener`: prints what it hears on `chatter`."""

import signal
import sys
from types import FrameType

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import String


class Listener(Node):
    """Prints one line per message."""

    def __init__(self) -> None:
        super().__init__("listener")
        self.create_subscription(String, "chatter", self._on_chatter, 10)

    def _on_chatter(self, message: String) -> None:
        sys.stdout.write(message.data + "\n")
        sys.stdout.flush()


def main() -> None:
    """Run the node until SIGINT or SIGTERM."""
    stop = False

    def on_signal(_number: int, _frame: FrameType | None) -> None:
        nonlocal stop
        stop = True

    signal.signal(signal.SIGINT, on_signal)
    signal.signal(signal.SIGTERM, on_signal)
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = Listener()
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    while not stop:
        executor.spin_once(timeout_sec=0.2)
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
