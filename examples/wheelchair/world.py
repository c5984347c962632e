"""A wheelchair in a corridor where obstacles pop up: a pure planar world, no ROS, no clock, no I/O.

Lengths are metres, angles radians, times seconds. The corridor runs along +x from 0 to `length_m`, its middle line
is y = 0. The same seed and the same commands give the same run.
"""

import math
import random
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

BEAMS = 120
FIELD_OF_VIEW_RAD = math.radians(270.0)
LIDAR_RANGE_M = 8.0

RADIUS_M = 0.30
START_X_M = 1.0
GOAL_TO_WALL_M = 1.5
GOAL_RADIUS_M = 0.4
# A wheelchair that leans on a post collides once, until it has been this far from it.
APART_M = 0.05

MAX_SPEED_MPS = 1.2
MAX_YAW_RATE_RADPS = 1.2
ACCELERATION_MPS2 = 0.8
BRAKING_MPS2 = 1.5
YAW_ACCELERATION_RADPS2 = 3.0

FIRST_MARKER_M = 3.0
MARKER_EVERY_M = 6.0
DRIFT_TURN_RADPM = 0.1
"""How far odometry with a drift of 1 would turn by itself on each metre."""

COMMAND_TIMEOUT_S = 0.3
MOVING_MPS = 0.05
STANDSTILL_MPS = 0.01


@dataclass(frozen=True)
class Obstacle:
    """A post with a round footprint that appears when the wheelchair's centre comes within `trigger_m` of it."""

    x_m: float
    y_m: float
    radius_m: float
    trigger_m: float


def place_obstacles(seed: int, length_m: float, width_m: float) -> tuple[Obstacle, ...]:
    """Return obstacles along the corridor, each leaving one side at least 1.1 m wide in a 2.4 m corridor.

    They are at least 3.5 m apart and appear at least 2.6 m ahead, so that a controller that is at most 0.4 s behind
    can still go round each of them at 0.9 m/s.
    """
    dice = random.Random(seed)
    obstacles = []
    x_m = START_X_M + 3.5 + dice.uniform(0.0, 1.5)
    while x_m < length_m - GOAL_TO_WALL_M - 2.0:
        radius_m = dice.uniform(0.18, 0.28)
        offset_m = dice.uniform(radius_m - 0.10, width_m / 2 - radius_m - 0.25)
        side = dice.choice((-1.0, 1.0))
        obstacles.append(Obstacle(x_m, side * offset_m, radius_m, dice.uniform(2.6, 3.4)))
        x_m += dice.uniform(3.5, 6.0)
    return tuple(obstacles)


class World:
    """The corridor, its obstacles and a differential-drive wheelchair with limited accelerations."""

    def __init__(self, seed: int = 0, length_m: float = 46.0, width_m: float = 2.4) -> None:
        if length_m < START_X_M + GOAL_TO_WALL_M + 1.0:
            raise ValueError(f"corridor of {length_m} m is too short for a start and a goal")
        self.length_m = length_m
        self.width_m = width_m
        self.goal = (length_m - GOAL_TO_WALL_M, 0.0)
        self.x_m, self.y_m, self.yaw_rad = START_X_M, 0.0, 0.0
        self.speed_mps, self.yaw_rate_radps = 0.0, 0.0
        self.collisions = 0
        self.goal_reached = False
        self.visible: list[Obstacle] = []
        self._hidden = list(place_obstacles(seed, length_m, width_m))
        self._touching = False
        self.beam_angles: NDArray[np.float64] = np.linspace(-FIELD_OF_VIEW_RAD / 2, FIELD_OF_VIEW_RAD / 2, BEAMS)

    def step(self, dt_s: float, speed_mps: float, yaw_rate_radps: float) -> None:
        """Advance by `dt_s` (at most about 50 ms for a sound integration) towards the wanted speeds."""
        speed = _clamp(speed_mps, MAX_SPEED_MPS)
        braking = abs(speed) < abs(self.speed_mps) or speed * self.speed_mps < 0.0
        change = (BRAKING_MPS2 if braking else ACCELERATION_MPS2) * dt_s
        self.speed_mps += _clamp(speed - self.speed_mps, change)
        yaw_rate = _clamp(yaw_rate_radps, MAX_YAW_RATE_RADPS)
        self.yaw_rate_radps += _clamp(yaw_rate - self.yaw_rate_radps, YAW_ACCELERATION_RADPS2 * dt_s)

        middle_rad = self.yaw_rad + self.yaw_rate_radps * dt_s / 2
        x_m = self.x_m + self.speed_mps * math.cos(middle_rad) * dt_s
        y_m = self.y_m + self.speed_mps * math.sin(middle_rad) * dt_s
        self.yaw_rad = math.remainder(self.yaw_rad + self.yaw_rate_radps * dt_s, math.tau)
        clearance_m = self._clearance_m(x_m, y_m)
        if clearance_m < 0.0:
            self.collisions += not self._touching
            self._touching = True
            self.speed_mps = 0.0
        else:
            self.x_m, self.y_m = x_m, y_m
            self._touching = self._touching and clearance_m < APART_M
        self._pop_up()
        if math.dist((self.x_m, self.y_m), self.goal) <= GOAL_RADIUS_M:
            self.goal_reached = True

    def scan(self) -> NDArray[np.float64]:
        """Return distances along `beam_angles` (relative to the heading); `inf` where nothing is within range."""
        directions = self.beam_angles + self.yaw_rad
        cosines, sines = np.cos(directions), np.sin(directions)
        with np.errstate(divide="ignore"):
            across = (np.copysign(self.width_m / 2, sines) - self.y_m) / sines
            along = (np.where(cosines > 0.0, self.length_m, 0.0) - self.x_m) / cosines
        ranges = np.minimum(np.abs(across), np.abs(along))
        for post in self.visible:
            dx_m, dy_m = post.x_m - self.x_m, post.y_m - self.y_m
            distance_m = math.hypot(dx_m, dy_m)
            if distance_m > LIDAR_RANGE_M + post.radius_m:
                continue
            ahead = dx_m * cosines + dy_m * sines
            depth = ahead**2 - distance_m**2 + post.radius_m**2
            hits = (depth >= 0.0) & (ahead > 0.0)
            ranges[hits] = np.minimum(ranges[hits], ahead[hits] - np.sqrt(depth[hits]))
        ranges[ranges > LIDAR_RANGE_M] = np.inf
        return ranges

    def _clearance_m(self, x_m: float, y_m: float) -> float:
        """Return room between the wheelchair's circle at that place and the nearest wall or post; negative in it."""
        room_m = min(self.width_m / 2 - abs(y_m), x_m, self.length_m - x_m)
        for post in self.visible:
            room_m = min(room_m, math.hypot(post.x_m - x_m, post.y_m - y_m) - post.radius_m)
        return room_m - RADIUS_M

    def _pop_up(self) -> None:
        # They lie in the order of x, so only the first hidden one can be the nearest ahead.
        while self._hidden:
            post = self._hidden[0]
            if math.hypot(post.x_m - self.x_m, post.y_m - self.y_m) > post.trigger_m:
                return
            self.visible.append(self._hidden.pop(0))


class WheelOdometry:
    """Where the wheels believe to be: with a drift of 0.05 each metre counts 5 % more and turns 0.005 rad."""

    def __init__(self, world: World, drift: float) -> None:
        self.x_m, self.y_m, self.yaw_rad = self._true = world.x_m, world.y_m, world.yaw_rad
        self._drift = drift

    def follow(self, world: World) -> None:
        """Count the way since the last call."""
        x_m, y_m, yaw_rad = self._true
        self._true = world.x_m, world.y_m, world.yaw_rad
        moved_m = (world.x_m - x_m) * math.cos(world.yaw_rad) + (world.y_m - y_m) * math.sin(world.yaw_rad)
        turned_rad = math.remainder(world.yaw_rad - yaw_rad, math.tau) + self._drift * DRIFT_TURN_RADPM * moved_m
        middle_rad = self.yaw_rad + turned_rad / 2
        self.x_m += moved_m * (1.0 + self._drift) * math.cos(middle_rad)
        self.y_m += moved_m * (1.0 + self._drift) * math.sin(middle_rad)
        self.yaw_rad = math.remainder(self.yaw_rad + turned_rad, math.tau)


class Markers:
    """Marks on the ceiling, each of which says where the wheelchair is that passes below."""

    def __init__(self) -> None:
        self._next_m = FIRST_MARKER_M

    def passed(self, x_m: float) -> bool:
        """Return whether a marker was passed since the last call."""
        if x_m < self._next_m:
            return False
        self._next_m += MARKER_EVERY_M
        return True


class Driver:
    """The wheels' own safety: a command time-out (dead man) and an inhibit switch, both braking to standstill.

    A *stop* is a standstill that one of the two forced on a moving wheelchair.
    """

    def __init__(self, timeout_s: float = COMMAND_TIMEOUT_S) -> None:
        self.inhibited = False
        self.stops = 0
        self._timeout_s = timeout_s
        self._command = (0.0, 0.0)
        self._command_s = -math.inf
        self._braking = False

    def command(self, now_s: float, speed_mps: float, yaw_rate_radps: float) -> None:
        """Take a command that arrived at `now_s` on the caller's steady clock."""
        self._command, self._command_s = (speed_mps, yaw_rate_radps), now_s

    def wanted(self, now_s: float, speed_mps: float) -> tuple[float, float]:
        """Return the speed and yaw rate the wheels shall aim for, given their present speed; count the stops."""
        if not self.inhibited and now_s - self._command_s <= self._timeout_s:
            self._braking = False
            return self._command
        if abs(speed_mps) > MOVING_MPS:
            self._braking = True
        elif self._braking and abs(speed_mps) < STANDSTILL_MPS:
            self._braking = False
            self.stops += 1
        return 0.0, 0.0


def _clamp(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))
