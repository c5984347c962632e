#!/usr/bin/env python3
"""ROS node `passenger`: says where to drive, one goal of the action `drive_to` after the other, and what came of it.

An ordinary client on the robot: it knows one server of `drive_to` and of `how_far`, wherever they are. Its account
(`passenger/account`, JSON, 10 Hz) is what `robot-offload demo` shows of goals and calls.
"""

import time
from typing import Any

from errands import Errand, Errands  # type: ignore[import-not-found]  # beside this script
from rclpy.action import ActionClient
from rclpy.node import Node
from running import run  # type: ignore[import-not-found]
from std_msgs.msg import String
from std_srvs.srv import Trigger
from test_msgs.action import Fibonacci

ACCOUNT_S = 0.1
ASK_S = 0.5
PATIENCE_S = 5.0
"""A call without an answer for so long is given up."""


class Passenger(Node):
    """Parameter: `goals_m`, distances along the corridor."""

    def __init__(self) -> None:
        super().__init__("passenger")
        self._goals_m = list(self.declare_parameter("goals_m", [44.5]).value)
        self._errands = Errands()
        self._call: tuple[Any, float] | None = None
        self._action = ActionClient(self, Fibonacci, "drive_to")
        self._service = self.create_client(Trigger, "how_far")
        self._said = self.create_publisher(String, "passenger/account", 10)
        self.create_timer(ACCOUNT_S, self._tell)
        self.create_timer(ASK_S, self._ask)

    def _send(self) -> None:
        errand = self._errands.begin()
        order = round(self._goals_m.pop(0) * 100)
        sent = self._action.send_goal_async(
            Fibonacci.Goal(order=order), feedback_callback=lambda message: self._on_feedback(errand, message)
        )
        sent.add_done_callback(lambda future: self._on_answer(errand, future.result()))

    def _on_answer(self, errand: Errand, handle: Any) -> None:
        self._errands.answered(errand, accepted=handle.accepted)
        if handle.accepted:
            handle.get_result_async().add_done_callback(lambda future: self._on_result(errand, future.result().status))

    def _on_feedback(self, errand: Errand, message: Any) -> None:
        process, tick, x_mm, y_mm, _ = message.feedback.sequence
        self._errands.heard(errand, process, tick, x_mm / 1e3, y_mm / 1e3)

    def _on_result(self, errand: Errand, status: int) -> None:
        self._errands.ended(errand, status)
        self._tell()

    def _tell(self) -> None:
        if self._errands.present is None and self._goals_m and self._action.server_is_ready():
            self._send()
        self._said.publish(String(data=self._errands.text()))

    def _ask(self) -> None:
        calls, now_s = self._errands.account.calls, time.monotonic()
        if self._call is not None and now_s - self._call[1] < PATIENCE_S:
            return
        if self._call is not None:
            calls.unanswered += 1
            self._service.remove_pending_request(self._call[0])
        self._call = None
        if self._errands.present is None or not self._service.service_is_ready():
            return
        calls.asked += 1
        future = self._service.call_async(Trigger.Request())
        self._call = (future, now_s)
        future.add_done_callback(lambda done: self._on_far(done.result(), now_s))

    def _on_far(self, answer: Trigger.Response, asked_s: float) -> None:
        calls, self._call = self._errands.account.calls, None
        calls.answered += answer.success
        calls.failed += not answer.success
        calls.longest_ms = max(calls.longest_ms, round((time.monotonic() - asked_s) * 1e3, 1))


if __name__ == "__main__":
    run(Passenger)
