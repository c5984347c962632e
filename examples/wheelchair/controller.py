#!/usr/bin/env python3
"""ROS node `controller`: follows the corridor to the goal and goes round obstacles, from the newest scan alone.

The law keeps nothing between two commands, so that a replica elsewhere can take over at any moment. The goal is one of
the action `drive_to`, or else the newest on the topic `goal_pose`. The node is an ordinary lifecycle node: it publishes
`cmd_vel` while it is Active, from a timer that runs in every state.
"""

import math
import time

import numpy as np
from drive_to import DriveTo  # type: ignore[import-not-found]  # beside this script, as planning is
from geometry_msgs.msg import PoseStamped, TwistStamped
from nav_msgs.msg import Odometry
from planning import GOAL_RADIUS_M, Floats, Planner, Pose  # type: ignore[import-not-found]
from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from running import run  # type: ignore[import-not-found]
from sensor_msgs.msg import LaserScan

MAX_INPUT_AGE_S = 0.3


class Controller(LifecycleNode):
    """Publishes `cmd_vel` while Active. Parameters: `rate_hz`, `max_speed` [m/s], `autostart`."""

    def __init__(self) -> None:
        super().__init__("controller")
        self.declare_parameter("rate_hz", 20.0)
        self.declare_parameter("max_speed", 0.6)
        self.declare_parameter("autostart", False)
        self._wall = Clock(clock_type=ClockType.SYSTEM_TIME)
        self._sequence = 0
        self._drive_to = DriveTo(self)
        self._goal: tuple[float, float] | None = None
        self._pose: Pose | None = None
        self._scan: tuple[Floats, Floats] | None = None
        self._heard_s = {"scan": -math.inf, "odom": -math.inf}

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Create the inputs, the output and the timer, which runs from now on in every state."""
        rate_hz = self.get_parameter("rate_hz").value
        self._planner = Planner(rate_hz, self.get_parameter("max_speed").value)
        newest = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        latched = QoSProfile(
            depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
        )
        self._inputs = [
            self.create_subscription(LaserScan, "scan", self._on_scan, newest),
            self.create_subscription(Odometry, "odom", self._on_odom, newest),
            self.create_subscription(PoseStamped, "goal_pose", self._on_goal, latched),
        ]
        reliable = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
        self._output = self.create_lifecycle_publisher(TwistStamped, "cmd_vel", reliable)
        self._timer = self.create_timer(1.0 / rate_hz, self._tick)
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Take goals. The localiser slept too: its last pose is an old one."""
        self._pose = None
        self._drive_to.activate()
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End its goal."""
        self._drive_to.deactivate()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Undo on_configure."""
        self.destroy_timer(self._timer)
        self.destroy_lifecycle_publisher(self._output)
        for subscription in self._inputs:
            self.destroy_subscription(subscription)
        return super().on_cleanup(state)

    def _on_scan(self, scan: LaserScan) -> None:
        ranges = np.asarray(scan.ranges, dtype=np.float64)
        ranges = np.where((ranges >= scan.range_min) & (ranges <= scan.range_max), ranges, np.inf)
        self._scan = (ranges, scan.angle_min + scan.angle_increment * np.arange(ranges.size))
        self._heard_s["scan"] = time.monotonic()

    def _on_odom(self, odom: Odometry) -> None:
        pose, twist = odom.pose.pose, odom.twist.twist
        yaw_rad = 2.0 * math.atan2(pose.orientation.z, pose.orientation.w)
        self._pose = Pose(pose.position.x, pose.position.y, yaw_rad, twist.linear.x, twist.angular.z)
        self._heard_s["odom"] = time.monotonic()

    def _on_goal(self, goal: PoseStamped) -> None:
        self._goal = (goal.pose.position.x, goal.pose.position.y)

    def _tick(self) -> None:
        if not self._output.is_activated:
            return
        if self._pose is None or self._scan is None:
            return
        goal = self._drive_to.target or self._goal
        speed_mps, yaw_rate_radps = 0.0, 0.0
        if time.monotonic() - min(self._heard_s.values()) > MAX_INPUT_AGE_S:
            self.get_logger().warning("Stopped: scan or odom was too old", throttle_duration_sec=2.0)
        elif goal is not None:
            speed_mps, yaw_rate_radps = self._planner.plan(*self._scan, self._pose, goal)
            self._drive_to.drove(self._pose.x_m, self._pose.y_m, GOAL_RADIUS_M)
        self._sequence += 1
        command = TwistStamped()
        command.header.stamp = self._wall.now().to_msg()
        # A consumer can tell duplicates, losses and reordering from it.
        command.header.frame_id = f"{self.get_name()}#{self._sequence}"
        command.twist.linear.x = speed_mps
        command.twist.angular.z = yaw_rate_radps
        self._output.publish(command)


def make() -> Controller:
    """Return the node, Active when nobody else manages it (`autostart`)."""
    node = Controller()
    if node.get_parameter("autostart").value:
        node.trigger_configure()
        node.trigger_activate()
    return node


if __name__ == "__main__":
    run(make)
