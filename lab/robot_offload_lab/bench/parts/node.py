"""What the bench's ROS programs share: messages that name who made them, and spinning until a signal comes."""

from __future__ import annotations

import array
import itertools
import os
import select
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from types import FrameType
from typing import Any, Final

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import CompressedImage

from robot_offload_lab.bench.observed import size_of

SPIN_S: Final = 0.2


class Stamped:
    """Makes messages with a time, `PRODUCER#SEQUENCE` and a payload; sizes take turns from message to message."""

    def __init__(self, producer: str, sizes: Sequence[int]) -> None:
        self._producer = producer
        self._sizes = tuple(sizes)
        self._numbers = itertools.count(1)
        # Made once: the cost of filling a message is not what is measured.
        self._messages = {size: CompressedImage(data=array.array("B", bytes(size))) for size in self._sizes}

    def next(self, now: Any) -> CompressedImage:
        """Return the next message; `now` is a ROS time."""
        number = next(self._numbers)
        message = self._messages[size_of(number, self._sizes)]
        message.header.stamp = now
        message.header.frame_id = f"{self._producer}#{number}"
        return message


def start() -> None:
    """Start ROS without its signal handlers: with them the context can vanish under a publish."""
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)


def spin(node: Any, attend: Callable[[], None] | None = None, every_s: float = SPIN_S) -> None:
    """Spin a node until SIGINT or SIGTERM, then end ROS. `attend` is called between two waits."""
    stop = False

    def on_signal(_number: int, _frame: FrameType | None) -> None:
        nonlocal stop
        stop = True

    signal.signal(signal.SIGINT, on_signal)
    signal.signal(signal.SIGTERM, on_signal)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    while not stop:
        executor.spin_once(timeout_sec=every_s)
        if attend is not None:
            attend()
    node.destroy_node()
    rclpy.shutdown()


def serve(nodes: Sequence[Any]) -> None:
    """Spin nodes until standard input ends, then end ROS."""
    executor = SingleThreadedExecutor()
    for node in nodes:
        executor.add_node(node)
    while not _ended():
        executor.spin_once(timeout_sec=SPIN_S)
    for node in nodes:
        node.destroy_node()
    rclpy.shutdown()


def _ended() -> bool:
    """Return whether standard input has ended; what is written to it is not for us."""
    return bool(select.select([sys.stdin], [], [], 0)[0]) and not os.read(sys.stdin.fileno(), 4096)


def spin_in_background(node: Any) -> None:
    """Spin a node on a thread of its own, which ends with the process or with ROS."""
    executor = SingleThreadedExecutor()
    executor.add_node(node)

    def run() -> None:
        with suppress(ExternalShutdownException):
            executor.spin()

    threading.Thread(target=run, name="ros", daemon=True).start()
