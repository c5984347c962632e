"""What the servers of a navigation stack have in common: one goal at a time, and a lifecycle.

As Nav2 has it: while a server is not Active it refuses goals, a new goal takes the place of the one before (which ends
ABORTED), every cancel is accepted, and deactivation aborts.
"""

from collections.abc import Callable
from typing import Any

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.task import Future

NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
COMMANDS = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Managed(LifecycleNode):
    """A lifecycle node that knows whether it is Active."""

    def __init__(self, name: str) -> None:
        super().__init__(name, start_parameter_services=False)
        self.acting = False
        self.wall = Clock(clock_type=ClockType.SYSTEM_TIME)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin to act."""
        self.acting = True
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop acting."""
        self.acting = False
        return super().on_deactivate(state)

    def every(self, period_s: float, act: Callable[[], None]) -> None:
        """Call a function periodically while the node is Active."""
        self.create_timer(period_s, lambda: act() if self.acting else None)


class Goals:
    """Serves one action of a node: `begin` and `work` are called with each request, `end` when it has ended."""

    def __init__(
        self,
        node: Managed,
        kind: Any,
        name: str,
        period_s: float,
        work: Callable[[Any], None],
        begin: Callable[[Any], None] = lambda _: None,
        end: Callable[[], None] = lambda: None,
    ) -> None:
        """Serve from now on; `work` is called every `period_s` while there is a goal."""
        self._kind = kind
        self._goal: ServerGoalHandle | None = None
        self._ended: dict[bytes, Future] = {}
        self._work, self._began, self._over = work, begin, end
        self._timer = node.create_timer(period_s, self._tick)
        self._timer.cancel()
        self._server = ActionServer(
            node,
            kind,
            name,
            self._execute,
            goal_callback=lambda _: GoalResponse.ACCEPT if node.acting else GoalResponse.REJECT,
            handle_accepted_callback=self._accepted,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )

    @property
    def running(self) -> bool:
        """Whether there is a goal."""
        return self._goal is not None

    def say(self, **feedback: Any) -> None:
        """Publish feedback of the goal."""
        if self._goal is not None:
            self._goal.publish_feedback(self._kind.Feedback(**feedback))

    def succeed(self, **result: Any) -> None:
        """End the goal well."""
        self._end("succeed", result)

    def abort(self) -> None:
        """End the goal, if there is one, because it cannot be reached or nobody shall go on with it here."""
        self._end("abort", {})

    def _accepted(self, goal: ServerGoalHandle) -> None:
        self.abort()
        self._goal = goal
        self._ended[bytes(goal.goal_id.uuid)] = Future()
        goal.execute()
        self._began(goal.request)
        self._timer.reset()
        self._tick()  # a replica that goes on with a goal has no period to lose

    async def _execute(self, goal: ServerGoalHandle) -> object:
        key = bytes(goal.goal_id.uuid)
        result = await self._ended[key]
        del self._ended[key]
        return result

    def _tick(self) -> None:
        if self._goal is None:
            self._timer.cancel()
        elif self._goal.is_cancel_requested:
            self._end("canceled", {})
        else:
            self._work(self._goal.request)

    def _end(self, how: str, result: dict[str, Any]) -> None:
        goal, self._goal = self._goal, None
        if goal is not None:
            self._over()
            getattr(goal, how)()
            self._ended[bytes(goal.goal_id.uuid)].set_result(self._kind.Result(**result))


class Server(Managed):
    """A node that serves actions; their goals end when it is deactivated."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self._served: list[Goals] = []

    def serve(self, *action: Any, **calls: Any) -> Goals:
        """Return the goals of a new action; for the arguments see `Goals`."""
        self._served.append(Goals(self, *action, **calls))
        return self._served[-1]

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End all goals and refuse others."""
        for goals in self._served:
            goals.abort()
        return super().on_deactivate(state)
