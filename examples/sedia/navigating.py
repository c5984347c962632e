"""The navigator: plans, follows, plans again each second, and gets free when it is stuck, as Nav2's behaviour trees do.

It gives its servers 20 ms to acknowledge a goal, which is Nav2's `default_server_timeout`, and ticks as long as it
has a goal. A server that is late is asked again, so that a busy computer costs moments and no goal.
"""

import math
import os
import time
from typing import Any

from action_msgs.msg import GoalStatus
from places import posed  # type: ignore[import-not-found]  # beside this script
from rclpy.action import ActionClient
from rclpy.duration import Duration
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.task import Future
from sedia_interfaces.action import BackUp, ComputePathToPose, FollowPath, NavigateToPose, Spin, Wait
from servers import Located  # type: ignore[import-not-found]

TICK_S = 0.02
ACKNOWLEDGED_S = 0.02
REPLAN_S = 1.0
ASK_AGAIN_S = 0.2
SAY_S = 0.1
MOST_RECOVERIES = 20
MOST_LATE = 50
"""Answers that may be late one after the other."""
RECOVERIES = ("wait", "back_up", "spin")


class Step:
    """One goal at a server."""

    def __init__(self, client: ActionClient, goal: Any) -> None:
        self._handle: Any = None
        self._unwanted = False
        self.status: int | None = None
        self.result: Any = None
        self._sent_s = time.monotonic()
        client.send_goal_async(goal).add_done_callback(self._answered)

    @property
    def late(self) -> bool:
        """Whether the server has not acknowledged it in time."""
        waits = self._handle is None and self.status is None
        return waits and time.monotonic() - self._sent_s > ACKNOWLEDGED_S

    @property
    def acknowledged(self) -> bool:
        """Whether the server has accepted it."""
        return self._handle is not None

    @property
    def succeeded(self) -> bool:
        """Whether it has ended well."""
        return self.status == GoalStatus.STATUS_SUCCEEDED

    def drop(self) -> None:
        """Cancel it; what becomes of it is of no interest any more."""
        self._unwanted = True
        if self._handle is not None and self.status is None:
            self._handle.cancel_goal_async()

    def _answered(self, future: Future) -> None:
        handle = future.result()
        if not handle.accepted:
            self.status = GoalStatus.STATUS_ABORTED
            return
        self._handle = handle
        handle.get_result_async().add_done_callback(self._ended)
        if self._unwanted:
            handle.cancel_goal_async()

    def _ended(self, future: Future) -> None:
        self.status, self.result = future.result().status, future.result().result


class BtNavigator(Located):
    """Serves `navigate_to_pose`."""

    def __init__(self) -> None:
        super().__init__("bt_navigator")
        kinds = {"compute_path_to_pose": ComputePathToPose, "follow_path": FollowPath}
        kinds |= {"spin": Spin, "back_up": BackUp, "wait": Wait}
        self._asked = {name: ActionClient(self, kind, name) for name, kind in kinds.items()}
        self._steps: dict[str, Step] = {}
        self._recoveries, self._late, self._said, self._said_s, self._planned_s = 0, 0, 0, 0.0, -math.inf
        self._goals = self.serve(NavigateToPose, "navigate_to_pose", TICK_S, self._tick, self._begin, self._stop)

    def _begin(self, _request: object) -> None:
        self._recoveries, self._late, self._planned_s = 0, 0, -math.inf

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin without a step under way."""
        self._steps.clear()
        return super().on_activate(state)

    def _stop(self) -> None:
        for step in self._steps.values():
            step.drop()
        self._steps.clear()

    def _send(self, name: str, goal: Any) -> None:
        if name in self._steps:
            self._steps[name].drop()
        if self._asked[name].server_is_ready():
            self._steps[name] = Step(self._asked[name], goal)

    def _tick(self, request: NavigateToPose.Goal) -> None:
        now_s = time.monotonic()
        if self.here is None:
            return
        self._say(request, now_s)
        self._forget_late(now_s)
        if self._late > MOST_LATE:
            self._goals.abort()
        elif not self._recovering():
            self._plan(request, now_s)
            self._follow()

    def _forget_late(self, now_s: float) -> None:
        """Drop what was not acknowledged in time, and plan again soon."""
        if any(step.acknowledged for step in self._steps.values()):
            self._late = 0
        for name in [name for name, step in self._steps.items() if step.late]:
            self._steps.pop(name).drop()
            self._late += 1
            self._planned_s = now_s - REPLAN_S + ASK_AGAIN_S
            self.get_logger().warning(f"{name} took more than 20 ms to answer, {self._late} in a row")

    def _say(self, request: NavigateToPose.Goal, now_s: float) -> None:
        if now_s - self._said_s < SAY_S or self.here is None:
            return
        self._said_s, self._said = now_s, self._said + 1
        to = request.pose.pose.position
        self._goals.say(
            process=os.getpid(),
            tick=self._said,
            pose=posed(self.here, self.wall.now().to_msg()),
            distance_remaining=math.dist((to.x, to.y), (self.here.x_m, self.here.y_m)),
            recoveries=min(self._recoveries, 255),
        )

    def _plan(self, request: NavigateToPose.Goal, now_s: float) -> None:
        planning = self._steps.get("compute_path_to_pose")
        if planning is not None and planning.status is not None:
            del self._steps["compute_path_to_pose"]
            if planning.succeeded:
                # A new path takes the place of the one before, which ends ABORTED and is forgotten here.
                self._steps.pop("follow_path", None)
                self._send("follow_path", FollowPath.Goal(path=planning.result.path))
            else:
                self._recover("there is no way")
        elif planning is None and now_s - self._planned_s > REPLAN_S:
            self._planned_s = now_s
            self._send("compute_path_to_pose", ComputePathToPose.Goal(goal=request.pose))

    def _follow(self) -> None:
        following = self._steps.get("follow_path")
        if following is None or following.status is None:
            return
        del self._steps["follow_path"]
        if following.succeeded:
            self._goals.succeed(recoveries=min(self._recoveries, 255))
        else:
            self._recover("the path could not be followed")

    def _recovering(self) -> bool:
        """Return whether it is getting free; end that when it has ended."""
        for name in RECOVERIES:
            step = self._steps.get(name)
            if step is not None:
                if step.status is None:
                    return True
                del self._steps[name]
                self._planned_s = -math.inf
        return False

    def _recover(self, why: str) -> None:
        self._stop()
        self._recoveries += 1
        self.get_logger().warning(f"Recovery {self._recoveries}: {why}")
        if self._recoveries > MOST_RECOVERIES:
            self._goals.abort()
            return
        goals = {
            "wait": Wait.Goal(time=Duration(seconds=0.2).to_msg()),
            "back_up": BackUp.Goal(distance=0.3, speed=0.2),
            "spin": Spin.Goal(angle=1.6),
        }
        name = RECOVERIES[self._recoveries % len(RECOVERIES)]
        self._send(name, goals[name])
