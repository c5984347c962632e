"""Between those who steer and the wheels, on the robot: jerks are smoothed, and nothing drives into what is near."""

import math
import time

import numpy as np
from geometry_msgs.msg import TwistStamped
from sensor_msgs.msg import LaserScan
from serving import COMMANDS, Managed  # type: ignore[import-not-found]  # beside this script

SLOWER_MPS2, FASTER_MPS2, TURN_RADPS2 = 2.0, 1.0, 4.0
ANEW_S = 0.5
"""After such a silence the wheels stand, and so does what is smoothed."""
STOP_M, HALF_WIDTH_M = 0.42, 0.34
SCAN_AGE_S = 0.5


class VelocitySmoother(Managed):
    """Passes the commands of controller and behaviours on (`cmd_vel_smoothed`), no faster than passengers like."""

    def __init__(self) -> None:
        super().__init__("velocity_smoother")
        self._last = (0.0, 0.0)
        self._last_s = -math.inf
        self._smoothed = self.create_publisher(TwistStamped, "cmd_vel_smoothed", COMMANDS)
        for topic in ("cmd_vel_nav", "cmd_vel_behavior"):
            self.create_subscription(TwistStamped, topic, self._smooth, COMMANDS)

    def _smooth(self, command: TwistStamped) -> None:
        if not self.acting:
            return
        now_s = time.monotonic()
        pause_s = now_s - self._last_s
        speed, turn = (0.0, 0.0) if pause_s > ANEW_S else self._last
        step_s = min(pause_s, 0.1)
        wanted = command.twist.linear.x - speed
        change = (FASTER_MPS2 if wanted * speed >= 0 else SLOWER_MPS2) * step_s
        speed += max(-change, min(change, wanted))
        change = TURN_RADPS2 * step_s
        turn += max(-change, min(change, command.twist.angular.z - turn))
        self._last, self._last_s = (speed, turn), now_s
        command.twist.linear.x, command.twist.angular.z = speed, turn
        self._smoothed.publish(command)


class CollisionMonitor(Managed):
    """The last before the wheels: lets nothing pass that drives into what the scanner sees right ahead."""

    def __init__(self) -> None:
        super().__init__("collision_monitor")
        self._free_m, self._seen_s = 0.0, -math.inf
        self._command = self.create_publisher(TwistStamped, "cmd_vel", COMMANDS)
        self.create_subscription(LaserScan, "scan", self._see, COMMANDS)
        self.create_subscription(TwistStamped, "cmd_vel_smoothed", self._pass, COMMANDS)

    def _see(self, scan: LaserScan) -> None:
        ranges = np.minimum(np.asarray(scan.ranges), 100.0)
        angles = scan.angle_min + scan.angle_increment * np.arange(ranges.size)
        ahead = (np.abs(ranges * np.sin(angles)) < HALF_WIDTH_M) & (np.cos(angles) > 0.0)
        self._free_m = float((ranges * np.cos(angles))[ahead].min(initial=100.0))
        self._seen_s = time.monotonic()

    def _pass(self, command: TwistStamped) -> None:
        if not self.acting:
            return
        blind = time.monotonic() - self._seen_s > SCAN_AGE_S
        if command.twist.linear.x > 0.0 and (blind or self._free_m < STOP_M):
            command.twist.linear.x = 0.0
        self._command.publish(command)
