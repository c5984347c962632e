"""Runs one ROS node as a process; the scripts beside this file share it."""

import signal
from collections.abc import Callable
from types import FrameType

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions


def run(make_node: Callable[[], Node]) -> None:
    """Makes a node and spins it until SIGINT or SIGTERM."""
    stop = False

    def on_signal(_number: int, _frame: FrameType | None) -> None:
        nonlocal stop
        stop = True

    signal.signal(signal.SIGINT, on_signal)
    signal.signal(signal.SIGTERM, on_signal)
    # Own handlers: with those of rclpy the context can vanish under a publish, which then raises.
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = make_node()
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    while not stop:
        executor.spin_once(timeout_sec=0.2)
    node.destroy_node()
    rclpy.shutdown()
