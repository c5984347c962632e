"""The action `/count` and the service `/ask` as Nav2's servers would serve them.

Written from the behaviour of Nav2's SimpleActionServer: while its node is Inactive goals are refused; a goal that
arrives while another runs takes its place, and the other ends ABORTED; deactivation aborts; a cancel is accepted.
A goal of order N counts N ticks of 20 ms. Feedback is [process, tick], the result [process, N].
"""

import os

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import Trigger
from test_msgs.action import Fibonacci

TICK_S = 0.02


class Counting:
    """One goal at a time."""

    def __init__(self, node: Node) -> None:
        self.node = node
        self.active = False
        self.goal: ServerGoalHandle | None = None
        self.ended: dict[bytes, Future] = {}
        self.tick = self.asked = 0
        self.server = ActionServer(
            node, Fibonacci, "/count", self.execute, goal_callback=self.requested,
            handle_accepted_callback=self.accepted, cancel_callback=lambda _: CancelResponse.ACCEPT,
        )  # fmt: skip
        node.create_service(Trigger, "/ask", self.ask)
        node.create_timer(TICK_S, self.count)

    def activate(self) -> None:
        self.active = True

    def deactivate(self) -> None:
        self.active = False
        self.end("abort")

    def requested(self, _goal: Fibonacci.Goal) -> GoalResponse:
        return GoalResponse.ACCEPT if self.active else GoalResponse.REJECT

    def accepted(self, goal: ServerGoalHandle) -> None:
        self.end("abort")
        self.goal, self.tick = goal, 0
        self.ended[bytes(goal.goal_id.uuid)] = Future()
        goal.execute()

    async def execute(self, goal: ServerGoalHandle) -> Fibonacci.Result:
        await self.ended[bytes(goal.goal_id.uuid)]
        return Fibonacci.Result(sequence=[os.getpid(), goal.request.order])

    def count(self) -> None:
        if self.goal is None:
            return
        if self.goal.is_cancel_requested:
            self.end("canceled")
            return
        self.tick += 1
        self.goal.publish_feedback(Fibonacci.Feedback(sequence=[os.getpid(), self.tick]))
        if self.tick >= self.goal.request.order:
            self.end("succeed")

    def end(self, how: str) -> None:
        if self.goal is None:
            return
        getattr(self.goal, how)()
        self.ended[bytes(self.goal.goal_id.uuid)].set_result(None)
        self.goal = None

    def ask(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.asked += 1
        response.success, response.message = True, f"{os.getpid()}#{self.asked}"
        return response
