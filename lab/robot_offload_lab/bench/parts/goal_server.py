"""Servers of an action and a service: in a replica of the bench, or plain, for what they cost without the product.

A goal of order N counts N ticks of 20 ms: feedback is [process, tick], the result [process, N]. A replica refuses goals
while it is Inactive, and its deactivation aborts those that run, as Nav2's servers do. `python -m ...goal_server` is
the replica, `python -m ...goal_server PREFIX` a plain node that serves PREFIX/count and PREFIX/ask.
"""

from __future__ import annotations

import os
import sys
from typing import Any, Final

import rclpy
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.task import Future
from std_srvs.srv import Trigger
from test_msgs.action import Fibonacci

from robot_offload_lab.bench.parts import node
from robot_offload_lab.bench.parts.replica import Replica

TICK_S: Final = 0.02


class Goals:
    """Any number of goals at once."""

    def __init__(self, owner: Any, prefix: str, *, active: bool) -> None:
        self.active = active
        self._running: dict[bytes, tuple[Any, Future]] = {}
        self._ticks: dict[bytes, int] = {}
        self._action = ActionServer(
            owner, Fibonacci, f"{prefix}/count", self._execute, goal_callback=self._asked,
            handle_accepted_callback=self._accepted, cancel_callback=lambda _: CancelResponse.ACCEPT,
        )  # fmt: skip
        owner.create_service(Trigger, f"{prefix}/ask", self._answer)
        owner.create_timer(TICK_S, self._tick)

    def deactivate(self) -> None:
        """Abort what runs."""
        self.active = False
        for key in list(self._running):
            self._end(key, "abort")

    def _asked(self, _goal: Any) -> GoalResponse:
        return GoalResponse.ACCEPT if self.active else GoalResponse.REJECT

    def _accepted(self, goal: Any) -> None:
        key = bytes(goal.goal_id.uuid)
        self._running[key], self._ticks[key] = (goal, Future()), 0
        goal.execute()

    async def _execute(self, goal: Any) -> Any:
        key = bytes(goal.goal_id.uuid)
        running = self._running.get(key)
        if running is not None:
            await running[1]
        return Fibonacci.Result(sequence=[os.getpid(), goal.request.order])

    def _tick(self) -> None:
        for key, (goal, _) in list(self._running.items()):
            self._ticks[key] += 1
            goal.publish_feedback(Fibonacci.Feedback(sequence=[os.getpid(), self._ticks[key]]))
            if goal.is_cancel_requested:
                self._end(key, "canceled")
            elif self._ticks[key] >= goal.request.order:
                self._end(key, "succeed")

    def _end(self, key: bytes, how: str) -> None:
        goal, ended = self._running.pop(key)
        getattr(goal, how)()
        ended.set_result(None)

    def _answer(self, _request: Any, response: Any) -> Any:
        response.success = True
        return response


class GoalReplica(Replica):
    """The bench's replica, with an action and a service."""

    def __init__(self) -> None:
        super().__init__()
        self._goals = Goals(self, "/bench", active=False)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Take goals."""
        self._goals.active = True
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Abort goals."""
        self._goals.deactivate()
        return super().on_deactivate(state)


def main() -> None:
    """Serve until SIGTERM."""
    node.start()
    if len(sys.argv) > 1 and sys.argv[1] != "--ros-args":
        plain = rclpy.create_node("direct_server")
        plain.goals = Goals(plain, sys.argv[1], active=True)  # lives as long as its node
        node.spin(plain)
    else:
        node.spin(GoalReplica())


if __name__ == "__main__":
    main()
