"""The actions `/count` and `/many` and the services `/ask` and `/do` of a replica, as Nav2's servers would serve them.

`/count` is a SimpleActionServer as Nav2 has it. `/many` runs any number of goals at once; deactivation aborts them. A
goal of order N counts N ticks of 20 ms; feedback is [process, tick], the result [process, N]. The cloud's replica
refuses goals of `/many` with the order HERE_ONLY. `/ask` answers `PROCESS#n`. `/do` remembers each request's number; a
negative one asks for all that were executed.
"""

import os

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node
from rclpy.task import Future
from simple_action_server import SimpleActionServer  # beside this file
from std_srvs.srv import Trigger
from test_msgs.action import Fibonacci
from test_msgs.srv import BasicTypes

TICK_S = 0.02
HERE_ONLY = 7777


def counted(goal: ServerGoalHandle, tick: int) -> Fibonacci.Result | None:
    """One step of a goal."""
    goal.publish_feedback(Fibonacci.Feedback(sequence=[os.getpid(), tick]))
    return Fibonacci.Result(sequence=[os.getpid(), goal.request.order]) if tick >= goal.request.order else None


class Run:
    """One goal that is being executed."""

    def __init__(self, goal: ServerGoalHandle) -> None:
        self.goal, self.tick, self.ended = goal, 0, Future()

    def end(self, how: str, result: Fibonacci.Result | None = None) -> None:
        getattr(self.goal, how)()
        self.ended.set_result(result or Fibonacci.Result())


class Counting:
    """See the module."""

    def __init__(self, node: Node) -> None:
        self.active = False
        self.runs: dict[bytes, Run] = {}
        self.asked = 0
        self.done: list[int] = []
        self.one = SimpleActionServer(node, Fibonacci, "/count", counted)
        self.many = ActionServer(
            node, Fibonacci, "/many", self.execute,
            goal_callback=lambda goal: GoalResponse.ACCEPT if self.takes(goal.order) else GoalResponse.REJECT,
            handle_accepted_callback=self.accepted, cancel_callback=lambda _: CancelResponse.ACCEPT,
        )  # fmt: skip
        self.elsewhere = "/cloud/" in node.resolve_service_name("/ask")
        node.create_service(Trigger, "/ask", self.ask)
        node.create_service(BasicTypes, "/do", self.do)
        node.create_timer(TICK_S, self.count)

    def takes(self, order: int) -> bool:
        return self.active and not (self.elsewhere and order == HERE_ONLY)

    def activate(self) -> None:
        self.active = True
        self.one.activate()

    def deactivate(self) -> None:
        self.active = False
        self.one.deactivate()
        for run in self.running():
            run.end("abort")

    def running(self) -> list[Run]:
        return [run for run in self.runs.values() if not run.ended.done()]

    def accepted(self, goal: ServerGoalHandle) -> None:
        self.runs[bytes(goal.goal_id.uuid)] = Run(goal)
        goal.execute()

    async def execute(self, goal: ServerGoalHandle) -> Fibonacci.Result:
        return await self.runs[bytes(goal.goal_id.uuid)].ended

    def count(self) -> None:
        self.one.turn()
        for run in self.running():
            run.tick += 1
            result = counted(run.goal, run.tick)
            if run.goal.is_cancel_requested:
                run.end("canceled")
            elif result is not None:
                run.end("succeed", result)

    def ask(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.asked += 1
        response.success, response.message = True, f"{os.getpid()}#{self.asked}"
        return response

    def do(self, request: BasicTypes.Request, response: BasicTypes.Response) -> BasicTypes.Response:
        if request.int32_value >= 0:
            self.done.append(request.int32_value)
        response.int32_value = request.int32_value
        response.string_value = " ".join(map(str, self.done)) if request.int32_value < 0 else ""
        return response
