#!/usr/bin/env python3
"""ROS node `wheelchair_base`: the simulated wheelchair, its laser scanner and the driver of its wheels.

Publishes `odom` (50 Hz), `scan` (20 Hz), `marker` (where it is, below each marker), `goal_pose` (latched) and
`wheelchair/state` (JSON, 10 Hz); obeys `cmd_vel` and the service `wheels_control/inhibit`. The run begins with the
first command (plus `start_delay_s`).
"""

import json
import math
import time
from pathlib import Path

from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from running import run  # type: ignore[import-not-found]
from sensor_msgs.msg import LaserScan
from std_msgs.msg import String
from std_srvs.srv import SetBool
from world import BEAMS, LIDAR_RANGE_M, Driver, Markers, WheelOdometry, World  # type: ignore[import-not-found]  # beside this script

STEP_S = 0.02
# After a longer pause of this process the world goes on from where it was.
MAX_CATCH_UP_S = 0.1


class Wheelchair(Node):
    """The robot and its surroundings.

    Parameters: `seed`, `corridor_length` [m], `odom_drift` (see `WheelOdometry`), `announce_goal` (whether `goal_pose`
    is published), `start_delay_s`, `log_file` (JSON lines; empty for none).
    """

    def __init__(self) -> None:
        super().__init__("wheelchair_base")
        seed = self.declare_parameter("seed", 0).value
        length_m = self.declare_parameter("corridor_length", 46.0).value
        drift = self.declare_parameter("odom_drift", 0.0).value
        announces = self.declare_parameter("announce_goal", True).value
        self._start_delay_s = self.declare_parameter("start_delay_s", 0.0).value
        log_file = self.declare_parameter("log_file", "").value
        self._log_file = Path(log_file) if log_file else None
        self._world = World(seed, length_m)
        self._odometry = WheelOdometry(self._world, drift)
        self._markers = Markers()
        self._driver = Driver()
        self._wall = Clock(clock_type=ClockType.SYSTEM_TIME)
        self._ran_s = 0.0
        self._first_command_s = math.inf
        self._last_tick_s = time.monotonic()

        reliable = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
        latched = QoSProfile(
            depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
        )
        self._odom = self.create_publisher(Odometry, "odom", 10)
        self._scan = self.create_publisher(LaserScan, "scan", qos_profile_sensor_data)
        self._state = self.create_publisher(String, "wheelchair/state", 10)
        self._marker = self.create_publisher(PoseStamped, "marker", 10)
        self.create_subscription(TwistStamped, "cmd_vel", self._on_command, reliable)
        self.create_service(SetBool, "wheels_control/inhibit", self._on_inhibit)
        self.create_timer(STEP_S, self._tick)
        self.create_timer(0.05, self._publish_scan)
        self.create_timer(0.1, self._publish_state)
        if announces:
            self._goal = self.create_publisher(PoseStamped, "goal_pose", latched)
            self._goal.publish(self._pose("odom", *self._world.goal, 0.0))

    def _on_command(self, command: TwistStamped) -> None:
        now_s = time.monotonic()
        self._first_command_s = min(self._first_command_s, now_s)
        self._driver.command(now_s, command.twist.linear.x, command.twist.angular.z)

    def _on_inhibit(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        if request.data != self._driver.inhibited:
            self.get_logger().info(f"{'Inhibited' if request.data else 'Released'} the wheels")
        self._driver.inhibited = request.data
        response.success = True
        response.message = "wheels are inhibited" if request.data else "wheels obey commands"
        return response

    def _tick(self) -> None:
        now_s = time.monotonic()
        elapsed_s = min(now_s - self._last_tick_s, MAX_CATCH_UP_S)
        self._last_tick_s = now_s
        if now_s - self._first_command_s >= self._start_delay_s:
            self._ran_s += elapsed_s
            steps = math.ceil(elapsed_s / STEP_S)
            for _ in range(steps):
                self._world.step(elapsed_s / steps, *self._driver.wanted(now_s, self._world.speed_mps))
                self._odometry.follow(self._world)
        stamp = self._wall.now().to_msg()
        self._publish_odom(stamp)
        world = self._world
        if self._markers.passed(world.x_m):
            marker = self._pose("map", world.x_m, world.y_m, world.yaw_rad)
            marker.header.stamp = stamp  # that of the odometry of the same moment
            self._marker.publish(marker)

    def _publish_odom(self, stamp: Time) -> None:
        world, believed = self._world, self._odometry
        odom = Odometry()
        odom.header.stamp = stamp
        odom.header.frame_id = "odom"
        odom.child_frame_id = "base_link"
        odom.pose.pose = self._pose("", believed.x_m, believed.y_m, believed.yaw_rad).pose
        odom.twist.twist.linear.x = world.speed_mps
        odom.twist.twist.angular.z = world.yaw_rate_radps
        self._odom.publish(odom)

    def _publish_scan(self) -> None:
        angles = self._world.beam_angles
        scan = LaserScan()
        scan.header.stamp = self._wall.now().to_msg()
        scan.header.frame_id = "base_link"
        scan.angle_min = float(angles[0])
        scan.angle_max = float(angles[-1])
        scan.angle_increment = float(angles[-1] - angles[0]) / (BEAMS - 1)
        scan.scan_time = 0.05
        scan.range_min = 0.01
        scan.range_max = LIDAR_RANGE_M
        scan.ranges = self._world.scan().tolist()
        self._scan.publish(scan)

    def _pose(self, frame: str, x_m: float, y_m: float, yaw_rad: float) -> PoseStamped:
        posed = PoseStamped()
        posed.header.stamp = self._wall.now().to_msg()
        posed.header.frame_id = frame
        posed.pose.position.x, posed.pose.position.y = x_m, y_m
        posed.pose.orientation.z, posed.pose.orientation.w = math.sin(yaw_rad / 2), math.cos(yaw_rad / 2)
        return posed

    def _publish_state(self) -> None:
        world = self._world
        state = {
            "t_s": round(self._ran_s, 3),
            "x": round(world.x_m, 3),
            "y": round(world.y_m, 3),
            "yaw": round(world.yaw_rad, 3),
            "speed": round(world.speed_mps, 3),
            "collisions": world.collisions,
            "stops": self._driver.stops,
            "inhibited": self._driver.inhibited,
            "goal_reached": world.goal_reached,
            "goal": list(world.goal),
            "corridor": {"length": world.length_m, "width": world.width_m},
            "obstacles": [[round(o.x_m, 3), round(o.y_m, 3), round(o.radius_m, 3)] for o in world.visible],
        }
        text = json.dumps(state)
        self._state.publish(String(data=text))
        if self._log_file and self._ran_s > 0.0:
            with self._log_file.open("a") as log:
                log.write(text + "\n")


if __name__ == "__main__":
    run(Wheelchair)
