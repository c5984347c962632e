"""The wheelchair's three rooms and its way through them, in virtual time; its description."""

from __future__ import annotations

import importlib
import math
from pathlib import Path
from typing import Any

import pytest

from robot_offload.api.files import load
from robot_offload_lab.run.showcase import showcase
from robot_offload_lab.run.system import check_runnable

EXAMPLES = Path(__file__).parents[3] / "examples"
SPEC = EXAMPLES / "sedia" / "robotoffload.yaml"
STEP_S = 0.025
PATIENCE_S = 120.0


@pytest.fixture
def modules(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The example's pure modules, as its scripts find them."""
    for name in ("wheelchair", "sedia"):
        monkeypatch.syspath_prepend(str(EXAMPLES / name))
    return {name: importlib.import_module(name) for name in ("rooms", "paths", "planning")}


def patrol(modules: Any, seed: int, rate_hz: float, max_speed_mps: float) -> tuple[Any, float]:
    """Drives through all rooms and back as planner and controller do; returns the building and the time it took."""
    rooms, paths, planning = (modules[name] for name in ("rooms", "paths", "planning"))
    grid = paths.Grid(rooms.grid(), rooms.CELL_M, (0.0, -rooms.WIDTH_M / 2))
    costs, building, law = paths.costs(grid), rooms.Building(seed), planning.Planner(rate_hz, max_speed_mps)
    drove_s = 0.0
    for goal in (*rooms.ROOMS, rooms.DOCK):
        way = paths.find(grid, costs, (building.x_m, building.y_m), goal)
        assert way, goal
        while math.dist((building.x_m, building.y_m), goal) >= planning.GOAL_RADIUS_M:
            here = planning.Pose(
                building.x_m, building.y_m, building.yaw_rad, building.speed_mps, building.yaw_rate_radps
            )
            target, _ = paths.steer_for(way, (here.x_m, here.y_m), 0.9)
            command = law.plan(building.scan(), building.beam_angles, here, target)
            for _ in range(round(1.0 / rate_hz / STEP_S)):
                building.step(STEP_S, *command)
            drove_s += 1.0 / rate_hz
            assert drove_s < PATIENCE_S, goal
        for _ in range(20):
            building.step(STEP_S, 0.0, 0.0)
    return building, drove_s


def test_the_patrol_visits_every_room_and_touches_nothing_and_is_faster_with_the_cloud(modules: Any) -> None:
    robots, robot_s = patrol(modules, 1, 10.0, 0.5)
    clouds, cloud_s = patrol(modules, 2, 20.0, 0.8)
    assert (robots.collisions, clouds.collisions) == (0, 0)
    assert robots.goal_reached
    assert clouds.goal_reached
    assert cloud_s < 0.8 * robot_s


def test_there_is_no_way_into_a_wall_and_the_way_keeps_off_walls(modules: Any) -> None:
    rooms, paths = modules["rooms"], modules["paths"]
    grid = paths.Grid(rooms.grid(), rooms.CELL_M, (0.0, -rooms.WIDTH_M / 2))
    costs = paths.costs(grid)
    assert paths.find(grid, costs, rooms.DOCK, (4.0, 2.0)) == []
    way = paths.find(grid, costs, rooms.DOCK, rooms.ROOMS[0])
    walls = rooms.walls()
    assert min(rooms.distances(walls, rooms.np.array(way))) > 0.3


def test_the_stack_has_22_managed_nodes_six_of_them_on_both_sides() -> None:
    offload, said = load(SPEC), showcase(SPEC)
    nodes = offload.spec.nodes
    assert len(nodes) == 22
    assert all(node.lifecycle for node in nodes)
    assert [node.name for node in nodes if node.duplicated] == [
        "amcl", "costmap", "planner_server", "controller_server", "behavior_server", "bt_navigator",
    ]  # fmt: skip
    assert [node.name for node in nodes if node.placement == "Cloud"] == ["detector"]
    assert {name for shared in said.processes for name in shared.nodes} == {node.name for node in nodes}
    check_runnable(offload, SPEC, said)
