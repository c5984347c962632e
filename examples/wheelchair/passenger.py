#!/usr/bin/env python3
"""ROS node `passenger`: says where to drive, one goal of the action `drive_to` after the other, and what came of it.

An ordinary client on the robot: it knows one server of `drive_to` and of `how_far`, wherever they are. Its account
(`passenger/account`, JSON, 10 Hz) is what `robot-offload demo` shows of goals and calls.
"""

import json
import time
from dataclasses import asdict, dataclass, field
from typing import Any

from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
from rclpy.node import Node
from running import run  # type: ignore[import-not-found]  # beside this script
from std_msgs.msg import String
from std_srvs.srv import Trigger
from test_msgs.action import Fibonacci

ACCOUNT_S = 0.1
ASK_S = 0.5
PATIENCE_S = 5.0
"""A call without an answer for so long is given up."""
ENDINGS = {
    GoalStatus.STATUS_SUCCEEDED: "succeeded",
    GoalStatus.STATUS_CANCELED: "canceled",
    GoalStatus.STATUS_ABORTED: "aborted",
}


@dataclass
class Errand:
    """What became of one goal.

    Attributes:
        goal: its number, from 1.
        accepted_ms: how long its acceptance took; None while it is not accepted.
        feedback: messages.
        servers: how many times another process went on with it, the first one included.
        backwards: feedback that came out of order.
        silence_ms: longest silence of its feedback since the last account.
        results: how many came; `ending` is the first: succeeded, canceled, aborted, or rejected.
        x_m, y_m: where its server believes to be.
    """

    goal: int
    accepted_ms: float | None = None
    feedback: int = 0
    servers: int = 0
    backwards: int = 0
    silence_ms: float = 0.0
    results: int = 0
    ending: str = ""
    x_m: float | None = None
    y_m: float | None = None


@dataclass
class Calls:
    """What became of the calls of `how_far`: answers with and without success, none at all, the longest wait."""

    asked: int = 0
    answered: int = 0
    failed: int = 0
    unanswered: int = 0
    longest_ms: float = 0.0


@dataclass
class Account:
    """Everything so far, as it is published."""

    goals: list[Errand] = field(default_factory=list)
    calls: Calls = field(default_factory=Calls)


class Passenger(Node):
    """Parameter: `goals_m`, distances along the corridor."""

    def __init__(self) -> None:
        super().__init__("passenger")
        self._goals_m = list(self.declare_parameter("goals_m", [44.5]).value)
        self._account = Account()
        self._sent_s = self._heard_s = 0.0
        self._last: tuple[int, int] = (0, 0)
        self._call: tuple[Any, float] | None = None
        self._action = ActionClient(self, Fibonacci, "drive_to")
        self._service = self.create_client(Trigger, "how_far")
        self._said = self.create_publisher(String, "passenger/account", 10)
        self.create_timer(ACCOUNT_S, self._tell)
        self.create_timer(ASK_S, self._ask)

    @property
    def _errand(self) -> Errand | None:
        """The present goal."""
        goals = self._account.goals
        return goals[-1] if goals and not goals[-1].ending else None

    def _send(self) -> None:
        errand = Errand(len(self._account.goals) + 1)
        self._account.goals.append(errand)
        self._sent_s, self._last = time.monotonic(), (0, 0)
        order = round(self._goals_m.pop(0) * 100)
        sent = self._action.send_goal_async(
            Fibonacci.Goal(order=order), feedback_callback=lambda message: self._on_feedback(errand, message)
        )
        sent.add_done_callback(lambda future: self._on_answer(errand, future.result()))

    def _on_answer(self, errand: Errand, handle: Any) -> None:
        if not handle.accepted:
            errand.ending = "rejected"
            return
        self._heard_s = time.monotonic()
        errand.accepted_ms = round((self._heard_s - self._sent_s) * 1e3, 1)
        handle.get_result_async().add_done_callback(lambda future: self._on_result(errand, future.result().status))

    def _on_feedback(self, errand: Errand, message: Any) -> None:
        process, tick, x_mm, y_mm, _ = message.feedback.sequence
        last_process, last_tick = self._last
        errand.servers += process != last_process
        errand.backwards += process == last_process and tick <= last_tick
        self._last = (process, tick)
        errand.feedback += 1
        errand.x_m, errand.y_m = x_mm / 1e3, y_mm / 1e3
        self._note_silence(errand)
        self._heard_s = time.monotonic()

    def _on_result(self, errand: Errand, status: int) -> None:
        errand.results += 1
        errand.ending = errand.ending or ENDINGS.get(status, f"status {status}")
        self._tell()

    def _note_silence(self, errand: Errand) -> None:
        if errand.accepted_ms is not None:
            errand.silence_ms = max(errand.silence_ms, round((time.monotonic() - self._heard_s) * 1e3, 1))

    def _tell(self) -> None:
        errand = self._errand
        if errand is not None:
            self._note_silence(errand)
        elif self._goals_m and self._action.server_is_ready():
            self._send()
        self._said.publish(String(data=json.dumps(asdict(self._account))))
        if errand is not None:
            errand.silence_ms = 0.0

    def _ask(self) -> None:
        calls, now_s = self._account.calls, time.monotonic()
        if self._call is not None and now_s - self._call[1] < PATIENCE_S:
            return
        if self._call is not None:
            calls.unanswered += 1
            self._service.remove_pending_request(self._call[0])
        self._call = None
        if self._errand is None or not self._service.service_is_ready():
            return
        calls.asked += 1
        future = self._service.call_async(Trigger.Request())
        self._call = (future, now_s)
        future.add_done_callback(lambda done: self._on_far(done.result(), now_s))

    def _on_far(self, answer: Trigger.Response, asked_s: float) -> None:
        calls, self._call = self._account.calls, None
        calls.answered += answer.success
        calls.failed += not answer.success
        calls.longest_ms = max(calls.longest_ms, round((time.monotonic() - asked_s) * 1e3, 1))


if __name__ == "__main__":
    run(Passenger)
