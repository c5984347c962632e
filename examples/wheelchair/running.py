"""Runs ROS nodes as a process; the scripts beside this file share it, and those of the example sedia."""

import signal
from collections.abc import Callable
from types import FrameType

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions


def run(*make_nodes: Callable[[], Node]) -> None:
    """Make nodes, one after the other, and spin them until SIGINT or SIGTERM."""
    stop = False

    def on_signal(_number: int, _frame: FrameType | None) -> None:
        nonlocal stop
        stop = True

    signal.signal(signal.SIGINT, on_signal)
    signal.signal(signal.SIGTERM, on_signal)
    # Own handlers: with those of rclpy the context can vanish under a publish, which then raises.
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    executor = SingleThreadedExecutor()
    nodes = [make_node() for make_node in make_nodes]
    for node in nodes:
        executor.add_node(node)
    while not stop:
        executor.spin_once(timeout_sec=0.2)
    for node in nodes:
        node.destroy_node()
    rclpy.shutdown()
