#!/usr/bin/env python3
"""ROS node `answering`: a topic, a service and an action under `/PLACE`, all of which tell who answers.

Parameters: `place`, the first word of all names, and `says`, what it calls itself.
"""

from typing import Any

from rclpy.action import ActionServer
from rclpy.node import Node
from running import run  # type: ignore[import-not-found]  # of the wheelchair, in the same folder there
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


if __name__ == "__main__":
    run(Answering)
