"""One ROS node and its executor in one process, started after the fork."""

from __future__ import annotations

import logging
import os
import threading
from collections.abc import Callable

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation as rclpy_native
from rclpy.node import Node
from rclpy.parameter import Parameter

from robot_offload_agent.settings.parameters import Configuration
from robot_offload_core.words.checks import BROKEN_EXIT, InvariantError

log = logging.getLogger(__name__)


UNDESCRIBED = (Parameter("start_type_description_service", value=False),)
"""For each node of the agent: the service that describes its types costs 1.5 MB in each process and is not used."""


def init(configuration: Configuration) -> None:
    """Start rclpy in this process, in the domain of this side; the agents ignore use_sim_time.

    SIGTERM ends spinning, so that participants leave properly. A thread that fails ends the process: half a process
    would look alive and do nothing, a dead one is restarted.
    """
    options = rclpy.SignalHandlerOptions.SIGTERM
    rclpy.init(args=[], domain_id=configuration["domain_id"], signal_handler_options=options)
    threading.excepthook = end_process


def end_process(failure: threading.ExceptHookArgs) -> None:
    """Log an exception that ended a thread and end the process; do nothing while rclpy is shutting down."""
    if rclpy.ok():
        thread = failure.thread.name if failure.thread else "?"
        log.error("Thread %s failed", thread, exc_info=failure.exc_value)
        os._exit(BROKEN_EXIT if isinstance(failure.exc_value, InvariantError) else 1)


def run_until_ended(run: Callable[[Configuration], None], configuration: Configuration) -> None:
    """Run a process; treat an end in the middle of its start as no error."""
    try:
        run(configuration)
    except (rclpy_native.RCLError, rclpy_native.InvalidHandle):
        if rclpy.ok():
            raise


def is_up() -> bool:
    """Return whether ROS of this process is still running."""
    return bool(rclpy.ok())


def make_node(configuration: Configuration, name: str) -> Node:
    """Return a plain node of an agent process, without the services that only cost memory."""
    return Node(
        name,
        namespace=configuration["namespace"],
        use_global_arguments=False,
        start_parameter_services=False,
        enable_rosout=False,
        parameter_overrides=[*UNDESCRIBED],
    )


def spin(*nodes: Node) -> None:
    """Spin until rclpy is shut down. SingleThreadedExecutor only: the EventsExecutor deadlocks."""
    executor = SingleThreadedExecutor()
    for node in nodes:
        executor.add_node(node)
    try:
        executor.spin()
    except ExternalShutdownException:
        return
