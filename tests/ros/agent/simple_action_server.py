"""An action server that behaves as Nav2's `SimpleActionServer` does, written from what it does, not from its source.

One goal runs, one more may wait. While the server is inactive goals are refused. A new goal asks the one that runs to
make way: at its next step that one ends ABORTED with an empty result, and the waiting one goes on in its place; a goal
that waited already ends at once. Cancels are always accepted and take effect at the next step: of the waiting goal, if
there is one, else of the running one, and then both end. Deactivation ends both, CANCELED if they were to be canceled,
else ABORTED.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node
from rclpy.task import Future

Step = Callable[[ServerGoalHandle, int], Any]
"""Given the running goal and the number of its step, returns its result, or None as long as it goes on."""


class SimpleActionServer:
    """See the module; its node calls `turn` for each step."""

    def __init__(self, node: Node, action_type: Any, name: str, step: Step) -> None:
        self.active = False
        self._step, self._empty = step, action_type.Result
        self._current: ServerGoalHandle | None = None
        self._pending: ServerGoalHandle | None = None
        self._steps = 0
        self._ended: dict[bytes, Future] = {}
        self._server = ActionServer(
            node, action_type, name, self._execute,
            goal_callback=lambda _: GoalResponse.ACCEPT if self.active else GoalResponse.REJECT,
            handle_accepted_callback=self._accepted, cancel_callback=lambda _: CancelResponse.ACCEPT,
        )  # fmt: skip

    def activate(self) -> None:
        self.active = True

    def deactivate(self) -> None:
        self.active = False
        self._terminate_all()

    def turn(self) -> None:
        """One step of the loop in which a server works on its goal."""
        if self._current is None:
            return
        if (self._pending or self._current).is_cancel_requested:
            self._terminate_all()
            return
        if self._pending is not None:
            self._end(self._current, "abort")
            self._current, self._pending, self._steps = self._pending, None, 0
        self._steps += 1
        result = self._step(self._current, self._steps)
        if result is not None:
            self._end(self._current, "succeed", result)
            self._current = None

    def _accepted(self, goal: ServerGoalHandle) -> None:
        self._ended[bytes(goal.goal_id.uuid)] = Future()
        goal.execute()
        if self._current is None:
            self._current, self._steps = goal, 0
            return
        if self._pending is not None:
            self._terminate(self._pending)
        self._pending = goal

    async def _execute(self, goal: ServerGoalHandle) -> Any:
        return await self._ended[bytes(goal.goal_id.uuid)]

    def _terminate_all(self) -> None:
        for goal in (self._current, self._pending):
            if goal is not None:
                self._terminate(goal)
        self._current = self._pending = None

    def _terminate(self, goal: ServerGoalHandle) -> None:
        self._end(goal, "canceled" if goal.is_cancel_requested else "abort")

    def _end(self, goal: ServerGoalHandle, how: str, result: Any = None) -> None:
        getattr(goal, how)()
        self._ended[bytes(goal.goal_id.uuid)].set_result(self._empty() if result is None else result)
