"""Three rooms along a corridor, for the planar simulator of the wheelchair example: walls, marks, a map. Pure, no ROS.

Metres, radians, seconds. x runs along the corridor from 0 to `LENGTH_M`, y = 0 is the middle of the building: the
corridor lies below, the rooms above, each with a door to it.
"""

import math
import random

import numpy as np
from numpy.typing import NDArray
from world import LIDAR_RANGE_M, RADIUS_M, Obstacle, World  # type: ignore[import-not-found]  # of the wheelchair

LENGTH_M = 12.0
WIDTH_M = 6.0
SILL_M = -1.0
"""Where the wall between corridor and rooms runs."""
DOOR_M = 1.5
CELL_M = 0.2
DOCK = (6.0, -2.0)
ROOMS = ((2.0, 1.0), (6.0, 1.0), (10.0, 1.0))
MARKS = ((2.0, -2.0), (4.0, -2.0), (8.0, -2.0), (10.0, -2.0), *ROOMS)
"""Marks on the ceiling; whoever passes below one knows where they are."""
BELOW_M = 0.4
VISITED_M = 0.6
SLOW_MPS = 0.15
BEAMS = 60


def walls() -> NDArray[np.float64]:
    """Return the walls as segments, a row each: x and y of both ends."""
    half = WIDTH_M / 2
    rows = [
        (0, -half, LENGTH_M, -half),
        (0, half, LENGTH_M, half),
        (0, -half, 0, half),
        (LENGTH_M, -half, LENGTH_M, half),
    ]
    rows += [(x, SILL_M, x, half) for x in (4.0, 8.0)]
    edges = [0.0]
    for x_m, _ in ROOMS:
        edges += [x_m - DOOR_M / 2, x_m + DOOR_M / 2]
    edges.append(LENGTH_M)
    rows += [(edges[i], SILL_M, edges[i + 1], SILL_M) for i in range(0, len(edges), 2)]
    return np.array(rows, dtype=np.float64)


def posts(seed: int) -> list[Obstacle]:
    """Return what stands in the corridor unseen until one comes close: a post on each side of the dock."""
    dice = random.Random(seed)
    return [
        Obstacle(x_m + dice.uniform(-0.3, 0.3), -2.0 + side * dice.uniform(0.55, 0.7), 0.15, 2.0)
        for x_m, side in ((4.0, dice.choice((-1, 1))), (8.0, dice.choice((-1, 1))))
    ]


class Building(World):
    """The rooms and a wheelchair in them; `goal_reached` once it has been in each room and is back at the dock."""

    def __init__(self, seed: int = 0) -> None:
        super().__init__(seed, LENGTH_M, WIDTH_M)
        self.goal = DOCK
        self.x_m, self.y_m = DOCK
        self.yaw_rad = math.pi
        self.visited: set[tuple[float, float]] = set()
        self.walls = walls()
        self.beam_angles = np.linspace(-math.radians(135), math.radians(135), BEAMS)
        self._hidden = posts(seed)

    def step(self, dt_s: float, speed_mps: float, yaw_rate_radps: float) -> None:
        """Advance by `dt_s` towards the wanted speeds, and note where the wheelchair has been."""
        super().step(dt_s, speed_mps, yaw_rate_radps)
        here = (self.x_m, self.y_m)
        slow = abs(self.speed_mps) < SLOW_MPS
        self.visited |= {room for room in ROOMS if slow and math.dist(room, here) < VISITED_M}
        self.goal_reached = len(self.visited) == len(ROOMS) and slow and math.dist(DOCK, here) < VISITED_M

    def scan(self) -> NDArray[np.float64]:
        """Return the distances along `beam_angles`; `inf` where nothing is within range."""
        directions = self.beam_angles + self.yaw_rad
        cosines, sines = np.cos(directions)[:, None], np.sin(directions)[:, None]
        ax, ay, bx, by = (self.walls[:, column] for column in range(4))
        along_x, along_y, from_x, from_y = bx - ax, by - ay, ax - self.x_m, ay - self.y_m
        with np.errstate(divide="ignore", invalid="ignore"):
            across = cosines * along_y - sines * along_x
            distance = (from_x * along_y - from_y * along_x) / across
            share = (from_x * sines - from_y * cosines) / across
            hit = (distance > 0.0) & (share >= 0.0) & (share <= 1.0)
        ranges = np.where(hit, distance, np.inf).min(axis=1)
        for post in self.visible:
            dx_m, dy_m = post.x_m - self.x_m, post.y_m - self.y_m
            ahead = dx_m * cosines[:, 0] + dy_m * sines[:, 0]
            depth = ahead**2 - dx_m**2 - dy_m**2 + post.radius_m**2
            struck = (depth >= 0.0) & (ahead > 0.0)
            ranges[struck] = np.minimum(ranges[struck], ahead[struck] - np.sqrt(depth[struck]))
        ranges[ranges > LIDAR_RANGE_M] = np.inf
        return ranges

    def _clearance_m(self, x_m: float, y_m: float) -> float:
        room_m = float(distances(self.walls, np.array([[x_m, y_m]]))[0])
        for post in self.visible:
            room_m = min(room_m, math.hypot(post.x_m - x_m, post.y_m - y_m) - post.radius_m)
        return room_m - RADIUS_M

    def _pop_up(self) -> None:
        near = [it for it in self._hidden if math.hypot(it.x_m - self.x_m, it.y_m - self.y_m) <= it.trigger_m]
        self.visible += near
        self._hidden = [it for it in self._hidden if it not in near]


class CeilingMarks:
    """Says when the wheelchair comes below a mark: once for each coming."""

    def __init__(self) -> None:
        self._below: tuple[float, float] | None = None

    def passed(self, x_m: float, y_m: float) -> bool:
        """Return whether a mark was reached since the last call."""
        below = next((mark for mark in MARKS if math.dist(mark, (x_m, y_m)) < BELOW_M), None)
        reached = below is not None and below != self._below
        self._below = below
        return reached


def distances(segments: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far each point is from the nearest segment."""
    start, along = segments[None, :, :2], segments[None, :, 2:] - segments[None, :, :2]
    share = ((points[:, None, :] - start) * along).sum(axis=2) / np.maximum((along**2).sum(axis=2), 1e-12)
    nearest = start + np.clip(share, 0.0, 1.0)[:, :, None] * along
    found: NDArray[np.float64] = np.sqrt(((points[:, None, :] - nearest) ** 2).sum(axis=2)).min(axis=1)
    return found


def grid() -> NDArray[np.int8]:
    """Return the map: rows along y from the lowest, cells of `CELL_M`, 100 where a wall is."""
    columns, rows = round(LENGTH_M / CELL_M), round(WIDTH_M / CELL_M)
    x_m, y_m = np.meshgrid((np.arange(columns) + 0.5) * CELL_M, (np.arange(rows) + 0.5) * CELL_M - WIDTH_M / 2)
    far = distances(walls(), np.stack((x_m.ravel(), y_m.ravel()), axis=1)).reshape(rows, columns)
    return np.where(far < CELL_M / 2 + 1e-6, 100, 0).astype(np.int8)
