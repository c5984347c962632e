"""The shortest way over a grid that keeps off walls (A*), and the point of a path to steer for. Pure, no ROS."""

import heapq
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

OCCUPIED = 50
KEEP_OFF_M = 0.35
"""Nearer to something than this no way leads."""
COMFORT_M = 0.8
Point = tuple[float, float]


@dataclass(frozen=True)
class Grid:
    """An occupancy grid as in nav_msgs: rows along y, `origin` is its lowest corner."""

    cells: NDArray[np.int8]
    cell_m: float
    origin: Point

    def cell(self, point: Point) -> tuple[int, int]:
        """Return row and column of a point, at the edge where the point lies outside."""
        column, row = ((at - low) / self.cell_m for at, low in zip(point, self.origin, strict=True))
        rows, columns = self.cells.shape
        return min(max(int(row), 0), rows - 1), min(max(int(column), 0), columns - 1)

    def point(self, row: int, column: int) -> Point:
        """Return the middle of a cell."""
        return self.origin[0] + (column + 0.5) * self.cell_m, self.origin[1] + (row + 0.5) * self.cell_m


def costs(grid: Grid) -> NDArray[np.float64]:
    """Return what a step onto each cell costs: 1 far from everything, more beside walls, infinite too close."""
    occupied = grid.cells >= OCCUPIED
    reach = math.ceil(COMFORT_M / grid.cell_m)
    distance = np.full(grid.cells.shape, COMFORT_M)
    padded = np.pad(occupied, reach, constant_values=True)
    rows, columns = grid.cells.shape
    for down in range(-reach, reach + 1):
        for right in range(-reach, reach + 1):
            there = padded[reach + down : reach + down + rows, reach + right : reach + right + columns]
            distance[there] = np.minimum(distance[there], math.hypot(down, right) * grid.cell_m)
    return np.where(distance < KEEP_OFF_M, np.inf, 1.0 + 4.0 * (COMFORT_M - distance) / COMFORT_M)


def find(grid: Grid, cost: NDArray[np.float64], start: Point, goal: Point) -> list[Point]:
    """Return the way from start to goal, a point per cell; empty when none leads there.

    Cells that are too close to something cost much, but can be left: a robot that stands in one is not lost.
    """
    first, last = grid.cell(start), grid.cell(goal)
    steps = [(down, right, math.hypot(down, right)) for down in (-1, 0, 1) for right in (-1, 0, 1) if down or right]
    best, before = {first: 0.0}, {first: first}
    queue = [(0.0, first)]
    while queue:
        _, here = heapq.heappop(queue)
        if here == last:
            way = [goal]
            while here != first:
                here = before[here]
                way.append(grid.point(*here))
            return way[::-1]
        for down, right, length in steps:
            there = (here[0] + down, here[1] + right)
            if not (0 <= there[0] < cost.shape[0] and 0 <= there[1] < cost.shape[1]):
                continue
            price = float(cost[there])
            if math.isinf(price):
                if grid.cells[there] >= OCCUPIED or there == last or not math.isinf(float(cost[here])):
                    continue
                price = 20.0
            total = best[here] + length * price
            if total < best.get(there, math.inf):
                best[there], before[there] = total, here
                heapq.heappush(queue, (total + math.dist(there, last), there))
    return []


def steer_for(path: Sequence[Point], here: Point, ahead_m: float) -> tuple[Point, float]:
    """Return the point of a path some way ahead of its nearest one, and how much of the path is left."""
    nearest = min(range(len(path)), key=lambda index: math.dist(path[index], here))
    left_m = sum(math.dist(path[index], path[index + 1]) for index in range(nearest, len(path) - 1))
    gone_m, index = 0.0, nearest
    while index + 1 < len(path) and gone_m < ahead_m:
        gone_m += math.dist(path[index], path[index + 1])
        index += 1
    return path[index], left_m + math.dist(path[nearest], here)
