"""The action `drive_to` and the service `how_far` of the controller: one goal at a time, as Nav2's servers have it.

The wheels of ROS 2 have no package of navigation actions, so the type is `test_msgs/action/Fibonacci`, numbers only:
the goal's `order` is the distance along the corridor in centimetres, feedback and result are [process, tick, x, y,
left] in millimetres; ticks only grow. On a robot with Nav2 it would be `nav2_msgs/action/NavigateToPose`.
"""

import math
import os

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import Trigger

try:
    from test_msgs.action import Fibonacci
except ModuleNotFoundError:  # not in every base image: then there is no action, goals come by topic
    Fibonacci = None


class DriveTo:
    """Serves the action for a node that does the driving.

    While the node is not Active goals are refused. A new goal takes the place of the one before, which ends ABORTED, as
    it does when the node is deactivated. Every cancel is accepted.
    """

    def __init__(self, node: Node) -> None:
        self._active = False
        self._goal: ServerGoalHandle | None = None
        self._ended: dict[bytes, Future] = {}
        self._told = [os.getpid(), 0, 0, 0, 0]
        if Fibonacci is not None:
            self._server = ActionServer(
                node,
                Fibonacci,
                "drive_to",
                self._execute,
                goal_callback=lambda _: GoalResponse.ACCEPT if self._active else GoalResponse.REJECT,
                handle_accepted_callback=self._accepted,
                cancel_callback=lambda _: CancelResponse.ACCEPT,
            )
        node.create_service(Trigger, "how_far", self._how_far)

    @property
    def target(self) -> tuple[float, float] | None:
        """Where to drive, x and y in metres; None: nowhere."""
        return None if self._goal is None else (self._goal.request.order / 100.0, 0.0)

    def activate(self) -> None:
        """Take goals from now on."""
        self._active = True

    def deactivate(self) -> None:
        """End the goal and refuse others."""
        self._active = False
        self._end("abort")

    def drove(self, x_m: float, y_m: float, arrived_m: float) -> None:
        """Publish how far the goal is, and end it when the place is at most `arrived_m` from it, or on a cancel."""
        if self._goal is None or self.target is None:
            return
        left_m = math.dist((x_m, y_m), self.target)
        self._told = [os.getpid(), self._told[1] + 1, *(round(metres * 1000) for metres in (x_m, y_m, left_m))]
        self._goal.publish_feedback(Fibonacci.Feedback(sequence=self._told))
        if self._goal.is_cancel_requested:
            self._end("canceled")
        elif left_m < arrived_m:
            self._end("succeed")

    def _accepted(self, goal: ServerGoalHandle) -> None:
        self._end("abort")
        self._goal = goal
        self._ended[bytes(goal.goal_id.uuid)] = Future()
        goal.execute()

    async def _execute(self, goal: ServerGoalHandle) -> object:
        key = bytes(goal.goal_id.uuid)
        sequence = await self._ended[key]
        del self._ended[key]
        return Fibonacci.Result(sequence=sequence)

    def _end(self, how: str) -> None:
        goal, self._goal = self._goal, None
        if goal is not None:
            getattr(goal, how)()
            self._ended[bytes(goal.goal_id.uuid)].set_result(list(self._told))

    def _how_far(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = True
        response.message = "no goal" if self._goal is None else f"{self._told[4] / 1000:.2f} m"
        return response
