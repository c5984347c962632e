"""A pod of a pool: serves `/share`, each call after a while, and answers with the pod's name."""

from __future__ import annotations

import contextlib
import os
import time

import rclpy
from rclpy.executors import ExternalShutdownException
from std_srvs.srv import Trigger

TAKES_S = 0.15


def answer(_request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
    """Answer after a while, as a node that computes does."""
    time.sleep(TAKES_S)
    response.success, response.message = True, os.environ["ROBOT_OFFLOAD_POD"]
    return response


def main() -> None:
    """Serve until the process is ended."""
    rclpy.init()
    node = rclpy.create_node("sharer")
    node.create_service(Trigger, "/share", answer)
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(node)


if __name__ == "__main__":
    main()
