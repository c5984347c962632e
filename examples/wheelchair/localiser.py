#!/usr/bin/env python3
"""ROS node `localiser`: says where the wheelchair is in the corridor (`pose`), from odometry and the markers it passes.

Odometry drifts. Each marker says how far; that correction is what the node knows and its inputs do not say again, so
it is the node's state: with the base class of `robot_offload_state` the replica on another computer gets it. A
replica that starts clean is wrong by all that has drifted, until it passes a marker.
"""

import json
import math
import struct
from collections import deque

from geometry_msgs.msg import Pose, PoseStamped
from nav_msgs.msg import Odometry
from place import Place  # type: ignore[import-not-found]  # beside this script, as running is
from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.qos import QoSProfile, ReliabilityPolicy
from running import run  # type: ignore[import-not-found]
from std_msgs.msg import String

from robot_offload_state import StatefulNode

VERSION = 1
STATE = struct.Struct("<4d")
"""A correction, and when it was published (system time, seconds)."""
KEPT_ODOMETRY = 50
"""Messages: a second of them, to find the one of a marker's moment."""


class Localiser(StatefulNode):
    """Publishes `pose` for each `odom`, and 10 times a second its state and `localiser/account`, while it is Active."""

    def __init__(self) -> None:
        super().__init__("localiser")
        self._wall = Clock(clock_type=ClockType.SYSTEM_TIME)
        self._correction = Place()
        self._restored_age_s: float | None = None
        self._odometry: deque[tuple[float, Place]] = deque(maxlen=KEPT_ODOMETRY)
        newest = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._pose = self.create_publisher(Odometry, "pose", newest)
        self._account = self.create_lifecycle_publisher(String, "localiser/account", 10)
        self.create_subscription(Odometry, "odom", self._on_odom, newest)
        self.create_subscription(PoseStamped, "marker", self._on_marker, 10)
        self.create_timer(0.1, self._tell)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Take the newest state of the replica that acted before, or begin clean."""
        self._correction, self._restored_age_s = Place(), None
        return super().on_activate(state)

    def take_state(self, version: int, data: bytes) -> None:
        """Take the correction that the replica on the other side knew."""
        if version != VERSION or len(data) != STATE.size:
            raise ValueError(f"{len(data)} bytes of version {version}")
        *place, made_s = STATE.unpack(data)
        if not all(map(math.isfinite, place)):
            raise ValueError("a place that is no number")
        self._correction = Place(*place)
        self._restored_age_s = self._now_s() - made_s

    def _on_odom(self, odom: Odometry) -> None:
        seen = _place(odom.pose.pose)
        self._odometry.append((_seconds(odom), seen))
        if not self._account.is_activated:
            return
        place = self._correction.then(seen)
        odom.header.frame_id = "map"
        odom.pose.pose.position.x, odom.pose.pose.position.y = place.x_m, place.y_m
        odom.pose.pose.orientation.z = math.sin(place.yaw_rad / 2)
        odom.pose.pose.orientation.w = math.cos(place.yaw_rad / 2)
        self._pose.publish(odom)

    def _on_marker(self, marker: PoseStamped) -> None:
        if not self._account.is_activated or not self._odometry:
            return
        stamp_s = _seconds(marker)
        _, seen = min(self._odometry, key=lambda entry: abs(entry[0] - stamp_s))
        self._correction = _place(marker.pose).then(seen.inverse())

    def _tell(self) -> None:
        if not self._account.is_activated:
            return
        place = self._correction
        self.publish_state(VERSION, STATE.pack(place.x_m, place.y_m, place.yaw_rad, self._now_s()))
        account = {"node": self.get_name(), "restored_age_s": self._restored_age_s, "at_s": self._now_s()}
        self._account.publish(String(data=json.dumps(account)))

    def _now_s(self) -> float:
        now_s: float = self._wall.now().nanoseconds / 1e9
        return now_s


def _place(pose: Pose) -> Place:
    return Place(pose.position.x, pose.position.y, 2.0 * math.atan2(pose.orientation.z, pose.orientation.w))


def _seconds(stamped: Odometry | PoseStamped) -> float:
    seconds: float = stamped.header.stamp.sec + stamped.header.stamp.nanosec / 1e9
    return seconds


if __name__ == "__main__":
    run(Localiser)
