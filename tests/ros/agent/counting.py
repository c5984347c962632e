"""The actions `/count` and `/many` and the services `/ask` and `/do` of a replica, as Nav2's servers would serve them.

`/count` behaves as Nav2's SimpleActionServer: while its node is Inactive goals are refused; a goal that arrives while
another runs takes its place, and the other ends ABORTED; deactivation aborts; a cancel is accepted. `/many` runs any
number of goals at once. A goal of order N counts N ticks of 20 ms; feedback is [process, tick], the result [process,
N]. `/ask` answers `PROCESS#n`. `/do` remembers each request's number; a negative one asks for all that were executed.
"""

import os
from functools import partial

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import Trigger
from test_msgs.action import Fibonacci
from test_msgs.srv import BasicTypes

TICK_S = 0.02


class Run:
    """One goal that is being executed."""

    def __init__(self, goal: ServerGoalHandle) -> None:
        self.goal, self.tick, self.ended = goal, 0, Future()

    def end(self, how: str) -> None:
        getattr(self.goal, how)()
        self.ended.set_result(None)


class Counting:
    """See the module."""

    def __init__(self, node: Node) -> None:
        self.active = False
        self.runs: dict[bytes, Run] = {}
        self.executing: dict[str, list[bytes]] = {"/count": [], "/many": []}
        self.asked = 0
        self.done: list[int] = []
        self.servers = [
            ActionServer(
                node, Fibonacci, name, self.execute, goal_callback=self.requested,
                handle_accepted_callback=partial(self.accepted, name), cancel_callback=lambda _: CancelResponse.ACCEPT,
            )
            for name in self.executing
        ]  # fmt: skip
        node.create_service(Trigger, "/ask", self.ask)
        node.create_service(BasicTypes, "/do", self.do)
        node.create_timer(TICK_S, self.count)

    def activate(self) -> None:
        self.active = True

    def deactivate(self) -> None:
        self.active = False
        for name in self.executing:
            self.end_all(name, "abort")

    def requested(self, _goal: Fibonacci.Goal) -> GoalResponse:
        return GoalResponse.ACCEPT if self.active else GoalResponse.REJECT

    def accepted(self, name: str, goal: ServerGoalHandle) -> None:
        if name == "/count":
            self.end_all(name, "abort")
        key = bytes(goal.goal_id.uuid)
        self.runs[key] = Run(goal)
        self.executing[name].append(key)
        goal.execute()

    async def execute(self, goal: ServerGoalHandle) -> Fibonacci.Result:
        await self.runs[bytes(goal.goal_id.uuid)].ended
        return Fibonacci.Result(sequence=[os.getpid(), goal.request.order])

    def count(self) -> None:
        for keys in self.executing.values():
            for key in list(keys):
                run = self.runs[key]
                run.tick += 1
                how = "canceled" if run.goal.is_cancel_requested else "succeed"
                run.goal.publish_feedback(Fibonacci.Feedback(sequence=[os.getpid(), run.tick]))
                if how == "canceled" or run.tick >= run.goal.request.order:
                    keys.remove(key)
                    run.end(how)

    def end_all(self, name: str, how: str) -> None:
        for key in self.executing[name]:
            self.runs[key].end(how)
        self.executing[name].clear()

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
