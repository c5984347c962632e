#!/usr/bin/env python3
"""ROS node `answering`: a topic, a service and an action under `/PLACE`, all of which tell who answers.

Parameters: `place`, the first word of all names, and `says`, what it calls itself.
"""

import signal
from types import FrameType
from typing import Any

import rclpy
from rclpy.action import ActionServer
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import String
from std_srvs.srv import Trigger
from test_msgs.action import Fibonacci

PERIOD_S = 0.2


class Answering(Node):
    """One publisher, one service, one action."""

    def __init__(self) -> None:
        super().__init__("answering")
        place = self.declare_parameter("place", "cloud").value
        self._says = str(self.declare_parameter("says", "somebody").value)
        self._output = self.create_publisher(String, f"/{place}/told", 10)
        self.create_service(Trigger, f"/{place}/answer", self._answer)
        self._action = ActionServer(self, Fibonacci, f"/{place}/count", self._count)
        self.create_timer(PERIOD_S, lambda: self._output.publish(String(data=self._says)))

    def _answer(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success, response.message = True, self._says
        return response

    def _count(self, goal: Any) -> Fibonacci.Result:  # rclpy does not type its handles
        numbers = [0, 1]
        while len(numbers) < goal.request.order:
            numbers.append(numbers[-1] + numbers[-2])
            goal.publish_feedback(Fibonacci.Feedback(sequence=numbers))
        goal.succeed()
        return Fibonacci.Result(sequence=numbers)


def main() -> None:
    """Runs the node until SIGINT or SIGTERM."""
    stop = False

    def on_signal(_number: int, _frame: FrameType | None) -> None:
        nonlocal stop
        stop = True

    signal.signal(signal.SIGINT, on_signal)
    signal.signal(signal.SIGTERM, on_signal)
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = Answering()
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    while not stop:
        executor.spin_once(timeout_sec=0.2)
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
