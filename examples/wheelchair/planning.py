"""The controller's law: from one scan, a pose and a goal to a speed and a yaw rate. Pure, no ROS."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FOOTPRINT_M = 0.30
KEEP_OUT_M = FOOTPRINT_M + 0.08
TIGHT_M = FOOTPRINT_M + 0.03
COMFORT_M = 0.22
CREEP_MPS = 0.25
FAR_M = 100.0
PATHS = 33
MAX_OFFSET_M = 1.0
STEP_M = 0.15
MAX_PATH_ANGLE_RAD = 1.0
MAX_YAW_RATE_RADPS = 0.9
COMFORT_BRAKING_MPS2 = 0.7
GOAL_RADIUS_M = 0.3

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Pose:
    """Where the wheelchair is, in the frame of its odometry, and how fast it moves and turns."""

    x_m: float
    y_m: float
    yaw_rad: float
    speed_mps: float
    yaw_rate_radps: float


def look_ahead_m(rate_hz: float) -> float:
    """Return how far ahead is planned: a faster computer affords longer paths. 1.6 m at 20 Hz, 2.2 m at 50 Hz."""
    return min(1.2 + 0.02 * rate_hz, 3.0)


class Planner:
    """Casts a fan of planned S-curves against the scan and takes the cheapest one.

    Each path starts with the present heading and ends in the direction of the goal, shifted sideways: the cubic
    y(u) = h (u^3 - 2u^2 + u) + d (3u^2 - 2u^3), u = x / length, with the first slope h and the shift d. Following
    the curvature at its start gives a damped approach (ratio 4 / (2 sqrt 6) = 0.82) to the path's end, at any speed.
    """

    def __init__(self, rate_hz: float, max_speed_mps: float) -> None:
        self._max_speed_mps = max_speed_mps
        self._length_m = look_ahead_m(rate_hz)
        self._offsets_m = np.linspace(-MAX_OFFSET_M, MAX_OFFSET_M, PATHS)
        steps = round(self._length_m / STEP_M)
        u = np.arange(1, steps + 1) / steps
        self._along_m = u * self._length_m
        self._slope_part = u**3 - 2.0 * u**2 + u
        self._shifts_m = self._offsets_m[:, None] * (3.0 * u**2 - 2.0 * u**3)[None, :]

    def plan(self, ranges: Floats, angles: Floats, pose: Pose, goal: tuple[float, float]) -> tuple[float, float]:
        """Return the wanted speed [m/s] and yaw rate [rad/s] for one scan.

        Args:
            ranges: distances of the beams in metres; `inf` means nothing there.
            angles: directions of the beams relative to the heading, in radians.
            pose: from odometry, in the goal's frame.
            goal: x and y of the place to go to.
        """
        dx_m, dy_m = goal[0] - pose.x_m, goal[1] - pose.y_m
        distance_m = math.hypot(dx_m, dy_m)
        if distance_m < GOAL_RADIUS_M:
            return 0.0, 0.0
        bearing_rad = math.remainder(math.atan2(dy_m, dx_m) - pose.yaw_rad, math.tau)
        if abs(bearing_rad) > MAX_PATH_ANGLE_RAD:
            return 0.0, math.copysign(0.6, bearing_rad)
        slope_m = -math.tan(bearing_rad) * self._length_m
        ranges = np.minimum(ranges, FAR_M)  # inf times a sine of zero would be no number
        clearances = self._clearances(ranges, angles - bearing_rad, slope_m)
        curvatures = (6.0 * self._offsets_m - 4.0 * slope_m) / self._length_m**2 * math.cos(bearing_rad) ** 3
        for keep_out_m, max_speed_mps in ((KEEP_OUT_M, self._max_speed_mps), (TIGHT_M, CREEP_MPS)):
            blocked = clearances < keep_out_m
            first = np.where(blocked.any(axis=1), blocked.argmax(axis=1), blocked.shape[1])
            free_m = np.concatenate(([0.0], self._along_m))[first]
            best = int(self._costs(clearances, free_m, curvatures, pose).argmin())
            stop_m = min(float(free_m[best]), distance_m)
            if stop_m > 2 * STEP_M:
                narrow_m = float(clearances[best, : int(first[best])].min()) - FOOTPRINT_M
                speed = min(max_speed_mps, math.sqrt(2.0 * COMFORT_BRAKING_MPS2 * (stop_m - 0.10)))
                speed *= min(1.0, max(0.45, narrow_m / COMFORT_M))
                curvature = float(curvatures[best])
                speed = min(speed, MAX_YAW_RATE_RADPS / max(abs(curvature), 1e-6))
                return speed, speed * curvature
        return 0.0, self._turn_to_open(ranges, angles, bearing_rad)

    def _clearances(self, ranges: Floats, angles: Floats, slope_m: float) -> Floats:
        """Return distance from each point of each path to the nearest scan point, shape (paths, steps).

        `angles` are relative to the direction of the goal, along which the paths are laid.
        """
        x_m, y_m = ranges * np.cos(angles), ranges * np.sin(angles)
        near = (x_m > -KEEP_OUT_M) & (x_m < self._length_m + 1.0)
        if not near.any():
            return np.full(self._shifts_m.shape, self._length_m)
        # Half the width is half the time, and a scan is not better than that.
        x_m, y_m = x_m[near].astype(np.float32), y_m[near].astype(np.float32)
        along_squared = (self._along_m.astype(np.float32)[:, None] - x_m[None, :]) ** 2
        aside = (self._shifts_m + slope_m * self._slope_part).astype(np.float32)
        squares = (aside[:, :, None] - y_m[None, None, :]) ** 2 + along_squared[None, :, :]
        return np.sqrt(squares.min(axis=2)).astype(np.float64)

    def _costs(self, clearances: Floats, free_m: Floats, curvatures: Floats, pose: Pose) -> Floats:
        """Return one number per path: blocked early, close to something, away from the goal, a jerk of the wheel."""
        ahead = self._along_m[None, :] <= free_m[:, None]
        closeness = np.exp(-(clearances - FOOTPRINT_M) / COMFORT_M) * ahead
        close = closeness.sum(axis=1) / np.maximum(ahead.sum(axis=1), 1.0)
        jerk = np.abs(curvatures - pose.yaw_rate_radps / max(pose.speed_mps, 0.3))
        blocked = 1.0 - free_m / self._length_m
        costs: Floats = 4.0 * blocked + 1.5 * close + 0.3 * np.abs(self._offsets_m) + 0.05 * jerk
        return costs

    @staticmethod
    def _turn_to_open(ranges: Floats, angles: Floats, bearing_rad: float) -> float:
        """Return the yaw rate towards the nearest heading with 0.8 m of free way, best near the goal's direction."""
        headings = np.linspace(-1.6, 1.6, 33)
        capped = np.minimum(ranges, 3.0)
        relative = angles[None, :] - headings[:, None]
        inside = (np.abs(capped * np.sin(relative)) < KEEP_OUT_M) & (np.cos(relative) > 0.0)
        free_m = np.where(inside, capped * np.cos(relative), np.inf).min(axis=1)
        costs = (free_m < 0.8) * 10.0 + np.abs(headings - bearing_rad) + 0.3 * np.abs(headings)
        return math.copysign(0.5, float(headings[int(costs.argmin())]))
