"""The servers of the stack: planner, controller, behaviours. Each takes one goal at a time, see `serving`."""

import math
import time

import numpy as np
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import OccupancyGrid, Odometry, Path
from paths import Grid, costs, find, steer_for  # type: ignore[import-not-found]  # beside this script
from places import Place, place, posed  # type: ignore[import-not-found]
from planning import GOAL_RADIUS_M, Planner, Pose  # type: ignore[import-not-found]  # of the wheelchair
from rclpy.duration import Duration
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from sedia_interfaces.action import BackUp, ComputePathToPose, FollowPath, Spin, Wait
from sensor_msgs.msg import LaserScan
from serving import COMMANDS, LATCHED, NEWEST, Server  # type: ignore[import-not-found]

MAX_INPUT_AGE_S = 0.4
AHEAD_M = 0.9
STUCK_S = 4.0
"""So long without getting nearer ends a path."""


class Located(Server):
    """A server that knows where it is: `pose` of the localiser on its own side."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.here: Place | None = None
        self.moving = (0.0, 0.0)
        self.heard_s = -math.inf
        self.create_subscription(Odometry, "pose", self._on_pose, NEWEST)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Forget: the localiser slept too, its last pose is an old one."""
        self.here = None
        return super().on_activate(state)

    def _on_pose(self, said: Odometry) -> None:
        if self.acting:
            self.here, self.heard_s = place(said.pose.pose), time.monotonic()
            self.moving = (said.twist.twist.linear.x, said.twist.twist.angular.z)


class PlannerServer(Located):
    """Serves `compute_path_to_pose` on the map, around what the costmap has seen."""

    def __init__(self) -> None:
        super().__init__("planner_server")
        self._grid: Grid | None = None
        self._costs = np.zeros((1, 1))
        self._plan = self.create_publisher(Path, "plan", 10)
        for topic in ("map", "local_costmap"):
            self.create_subscription(OccupancyGrid, topic, self._on_map, LATCHED)
        self._goals = self.serve(ComputePathToPose, "compute_path_to_pose", 0.02, self._work)

    def _on_map(self, said: OccupancyGrid) -> None:
        cells = np.asarray(said.data, dtype=np.int8).reshape(said.info.height, said.info.width)
        origin = said.info.origin.position
        self._grid = Grid(cells, said.info.resolution, (origin.x, origin.y))
        self._costs = costs(self._grid)

    def _work(self, request: ComputePathToPose.Goal) -> None:
        if self._grid is None or self.here is None:
            return
        began_s, to = time.monotonic(), place(request.goal.pose)
        way = find(self._grid, self._costs, (self.here.x_m, self.here.y_m), (to.x_m, to.y_m))
        if not way:
            self._goals.abort()
            return
        path = Path()
        path.header.frame_id, path.header.stamp = "map", self.wall.now().to_msg()
        path.poses = [posed(Place(x_m, y_m, to.yaw_rad), path.header.stamp) for x_m, y_m in way]
        self._plan.publish(path)
        self._goals.succeed(path=path, planning_time=Duration(seconds=time.monotonic() - began_s).to_msg())


class Driving(Located):
    """A server that steers: its commands name their maker and their number, so that a consumer can tell them apart."""

    def __init__(self, name: str, topic: str) -> None:
        super().__init__(name)
        self._sequence = 0
        self._commands = self.create_publisher(TwistStamped, topic, COMMANDS)

    def command(self, speed_mps: float, turn_radps: float) -> None:
        """Publish one command."""
        self._sequence += 1
        said = TwistStamped()
        said.header.stamp, said.header.frame_id = self.wall.now().to_msg(), f"{self.get_name()}#{self._sequence}"
        said.twist.linear.x, said.twist.angular.z = speed_mps, turn_radps
        self._commands.publish(said)


class ControllerServer(Driving):
    """Serves `follow_path`: steers while it has a path, else it is silent. Parameters: `rate_hz`, `max_speed`."""

    def __init__(self) -> None:
        super().__init__("controller_server", "cmd_vel_nav")
        rate_hz = self.declare_parameter("rate_hz", 10.0).value
        self._law = Planner(rate_hz, self.declare_parameter("max_speed", 0.5).value)
        self._scan: tuple[np.ndarray, np.ndarray] | None = None
        self._seen_s = self._began_s = self._nearer_s = 0.0
        self._least_m = math.inf
        self._path: list[tuple[float, float]] = []
        self.create_subscription(LaserScan, "scan", self._on_scan, NEWEST)
        self._goals = self.serve(FollowPath, "follow_path", 1.0 / rate_hz, self._work, self._begin)

    def _on_scan(self, scan: LaserScan) -> None:
        if self.acting:
            ranges = np.asarray(scan.ranges, dtype=np.float64)
            self._scan = (ranges, scan.angle_min + scan.angle_increment * np.arange(ranges.size))
            self._seen_s = time.monotonic()

    def _begin(self, request: FollowPath.Goal) -> None:
        self._path = [(it.pose.position.x, it.pose.position.y) for it in request.path.poses]
        self._began_s = self._nearer_s = time.monotonic()
        self._least_m = math.inf

    def _work(self, _request: FollowPath.Goal) -> None:
        now_s = time.monotonic()
        if self.here is None or self._scan is None or now_s - min(self.heard_s, self._seen_s) > MAX_INPUT_AGE_S:
            self.command(0.0, 0.0)
            return
        here = (self.here.x_m, self.here.y_m)
        target, left_m = steer_for(self._path, here, AHEAD_M)
        if left_m < self._least_m - 0.1:
            self._least_m, self._nearer_s = left_m, now_s
        if math.dist(here, self._path[-1]) < GOAL_RADIUS_M:
            self.command(0.0, 0.0)
            self._goals.succeed(driving_time=Duration(seconds=now_s - self._began_s).to_msg())
        elif now_s - self._nearer_s > STUCK_S:
            self.command(0.0, 0.0)
            self._goals.abort()
        else:
            speed, turn = self._law.plan(*self._scan, Pose(*here, self.here.yaw_rad, *self.moving), target)
            self.command(speed, turn)
            self._goals.say(distance_to_goal=left_m, speed=speed)


class BehaviorServer(Driving):
    """Serves what a robot does that is stuck: `spin`, `back_up`, `wait`."""

    def __init__(self) -> None:
        super().__init__("behavior_server", "cmd_vel_behavior")
        self._begun: tuple[Place, float] | None = None
        self._turned = 0.0
        self._spins = self.serve(Spin, "spin", 0.1, self._spin, self._begin)
        self._backs = self.serve(BackUp, "back_up", 0.1, self._back_up, self._begin)
        self._waits = self.serve(Wait, "wait", 0.1, self._wait, self._begin)

    def _begin(self, _request: object) -> None:
        self._begun, self._turned = None, 0.0

    def _since(self) -> tuple[Place, float] | None:
        """Return where and when it began, once that is known."""
        if self._begun is None and self.here is not None:
            self._begun = (self.here, time.monotonic())
        return self._begun

    def _spin(self, request: Spin.Goal) -> None:
        begun = self._since()
        if begun is None or self.here is None:
            return
        step = math.remainder(self.here.yaw_rad - begun[0].yaw_rad, math.tau)
        self._begun = (self.here, begun[1])
        self._turned += step
        if abs(self._turned) >= abs(request.angle) - 0.1:
            self.command(0.0, 0.0)
            self._spins.succeed(turned=self._turned)
        else:
            self.command(0.0, math.copysign(0.8, request.angle))
            self._spins.say(turned=self._turned)

    def _back_up(self, request: BackUp.Goal) -> None:
        begun = self._since()
        if begun is None or self.here is None:
            return
        moved_m = math.dist((begun[0].x_m, begun[0].y_m), (self.here.x_m, self.here.y_m))
        if moved_m >= request.distance or time.monotonic() - begun[1] > 4.0:
            self.command(0.0, 0.0)
            self._backs.succeed(moved=moved_m)
        else:
            self.command(-abs(request.speed), 0.0)
            self._backs.say(moved=moved_m)

    def _wait(self, request: Wait.Goal) -> None:
        begun = self._since()
        if begun is None:
            return
        waited_s, wanted_s = time.monotonic() - begun[1], Duration.from_msg(request.time).nanoseconds / 1e9
        if waited_s >= wanted_s:
            self._waits.succeed(waited=Duration(seconds=waited_s).to_msg())
        else:
            self._waits.say(left=Duration(seconds=wanted_s - waited_s).to_msg())
