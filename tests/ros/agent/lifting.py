"""The action `/lift` outside the group: any number of goals at once, each counts its order in ticks of 20 ms."""

import os

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node
from rclpy.task import Future
from test_msgs.action import Fibonacci

TICK_S = 0.02


class Lift:
    """See the module.

    Attributes:
        running: by the goal's number, each goal that is executed and its ticks.
        ends: by the goal's number, what its end is told to.
    """

    def __init__(self, node: Node) -> None:
        self.serves = True
        self.running: dict[bytes, tuple[ServerGoalHandle, int]] = {}
        self.ends: dict[bytes, Future] = {}
        self.server = ActionServer(
            node, Fibonacci, "/lift", self.execute,
            goal_callback=lambda _: GoalResponse.ACCEPT if self.serves else GoalResponse.REJECT,
            handle_accepted_callback=self.accepted, cancel_callback=lambda _: CancelResponse.ACCEPT,
        )  # fmt: skip
        node.create_timer(TICK_S, self.count)

    def accepted(self, goal: ServerGoalHandle) -> None:
        number = bytes(goal.goal_id.uuid)
        self.ends[number] = Future()
        self.running[number] = goal, 0
        goal.execute()

    async def execute(self, goal: ServerGoalHandle) -> Fibonacci.Result:
        await self.ends[bytes(goal.goal_id.uuid)]
        return Fibonacci.Result(sequence=[os.getpid(), goal.request.order])

    def count(self) -> None:
        for number, (goal, tick) in list(self.running.items()):
            self.running[number] = goal, tick + 1
            goal.publish_feedback(Fibonacci.Feedback(sequence=[os.getpid(), tick + 1]))
            if goal.is_cancel_requested or tick + 1 >= goal.request.order:
                del self.running[number]
                (goal.canceled if goal.is_cancel_requested else goal.succeed)()
                self.ends[number].set_result(None)
