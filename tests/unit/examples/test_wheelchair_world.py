"""The wheelchair's world, its driver and the controller's law, in virtual time."""

import itertools
import math
import random
from collections import deque
from dataclasses import dataclass

import numpy as np
import pytest

from examples.wheelchair.planning import Planner, Pose
from examples.wheelchair.world import (
    BEAMS,
    COMMAND_TIMEOUT_S,
    RADIUS_M,
    Driver,
    Obstacle,
    World,
    place_obstacles,
)

TICK_S = 0.02
SEEDS = range(20)
ROBOT = (20.0, 0.6)
CLOUD = (50.0, 0.9)


@dataclass(frozen=True)
class Link:
    """What lies between the controller and the wheels."""

    delay_s: float = 0.0
    gap_s: float = 0.0
    outage_s: float = 0.0  # of every 20 s


@dataclass(frozen=True)
class Run:
    """How a run ended."""

    world: World
    driver: Driver
    took_s: float


def drive(seed: int, controllers: list[tuple[float, float]], link: Link, limit_s: float = 150.0) -> Run:
    """One run to the goal; several (rate, speed) controllers act by turns of 10 s, as after changeovers."""
    world, driver, dice = World(seed), Driver(), random.Random(seed)
    planners = [(Planner(rate_hz, speed), 1.0 / rate_hz) for rate_hz, speed in controllers]
    on_the_way: deque[tuple[float, float, float]] = deque()
    scan, next_scan_s, next_command_s, silent_until_s = world.scan(), 0.0, 0.0, 0.0
    tick = 0
    while not world.goal_reached and tick * TICK_S < limit_s:
        now_s = tick * TICK_S
        planner, period_s = planners[int(now_s / 10.0) % len(planners)]
        if now_s >= next_scan_s - 1e-9:
            scan, next_scan_s = world.scan(), next_scan_s + 0.05
        if now_s >= next_command_s - 1e-9:
            next_command_s += period_s
            pose = Pose(world.x_m, world.y_m, world.yaw_rad, world.speed_mps, world.yaw_rate_radps)
            command = planner.plan(scan, world.beam_angles, pose, world.goal)
            if now_s >= silent_until_s and dice.random() < 0.05:
                silent_until_s = now_s + link.gap_s - period_s
            if now_s >= silent_until_s and now_s % 20.0 < 20.0 - link.outage_s:
                on_the_way.append((now_s + link.delay_s, *command))
        while on_the_way and on_the_way[0][0] <= now_s + 1e-9:
            _, speed, yaw_rate = on_the_way.popleft()
            driver.command(now_s, speed, yaw_rate)
        world.step(TICK_S, *driver.wanted(now_s, world.speed_mps))
        tick += 1
    return Run(world, driver, tick * TICK_S)


@pytest.mark.parametrize("controller", [ROBOT, CLOUD], ids=["robot", "cloud"])
def test_with_gaps_of_200_ms_and_100_ms_of_delay_every_seed_reaches_the_goal_unhurt(
    controller: tuple[float, float],
) -> None:
    runs = [drive(seed, [controller], Link(delay_s=0.1, gap_s=0.2)) for seed in SEEDS]

    assert [run.world.collisions for run in runs] == [0] * len(SEEDS)
    assert all(run.world.goal_reached for run in runs)
    assert [run.driver.stops for run in runs] == [0] * len(SEEDS)


def test_controllers_that_take_turns_reach_the_goal_in_about_a_minute() -> None:
    runs = [drive(seed, [ROBOT, CLOUD], Link(delay_s=0.02)) for seed in SEEDS]

    assert [run.world.collisions for run in runs] == [0] * len(SEEDS)
    assert all(run.world.goal_reached for run in runs)
    times_s = sorted(run.took_s for run in runs)
    assert 60.0 <= times_s[len(times_s) // 2] <= 68.0
    assert times_s[-1] < 75.0


def test_the_dead_man_stops_the_wheels_in_every_outage() -> None:
    for seed in range(5):
        run = drive(seed, [CLOUD], Link(delay_s=0.03, outage_s=4.0))

        outages = int((run.took_s + 4.0 - COMMAND_TIMEOUT_S - 1.0) // 20.0)
        assert outages >= 2
        assert run.driver.stops == outages
        assert run.world.collisions == 0
        assert run.world.goal_reached


def test_the_same_seed_and_commands_give_the_same_run() -> None:
    first, second = (drive(4, [CLOUD], Link(delay_s=0.05, gap_s=0.1)) for _ in range(2))

    assert (first.world.x_m, first.world.y_m, first.took_s) == (
        second.world.x_m,
        second.world.y_m,
        second.took_s,
    )
    assert first.world.visible == second.world.visible
    assert place_obstacles(4, 46.0, 2.4) != place_obstacles(5, 46.0, 2.4)


def test_every_obstacle_leaves_a_passable_side_and_time_to_react() -> None:
    for seed in range(200):
        obstacles = place_obstacles(seed, 46.0, 2.4)
        assert len(obstacles) >= 6
        for obstacle in obstacles:
            assert 1.2 + abs(obstacle.y_m) - obstacle.radius_m >= 1.1 > 2 * RADIUS_M
            assert obstacle.trigger_m >= 2.6
        places_m = [obstacle.x_m for obstacle in obstacles]
        assert min(b - a for a, b in itertools.pairwise(places_m)) >= 3.5


def test_an_obstacle_appears_only_when_the_wheelchair_comes_near() -> None:
    world = World(seed=0)
    post = place_obstacles(0, world.length_m, world.width_m)[0]
    assert world.visible == []

    while not world.visible:
        world.step(TICK_S, 0.6, 0.0)

    assert world.visible == [post]
    distance_m = math.dist((world.x_m, world.y_m), (post.x_m, post.y_m))
    assert post.trigger_m - 0.02 < distance_m <= post.trigger_m


def test_driving_blindly_into_a_wall_is_one_collision_however_long_it_pushes() -> None:
    world = World(seed=0)
    world.yaw_rad = math.pi / 2

    for _ in range(500):
        world.step(TICK_S, 0.6, 0.0)

    assert world.collisions == 1
    assert world.speed_mps == 0.0
    assert abs(world.y_m) <= world.width_m / 2 - RADIUS_M


def test_backing_off_and_hitting_again_is_a_second_collision() -> None:
    world = World(seed=0)
    world.visible.append(Obstacle(2.0, 0.0, 0.2, 1.0))

    for speed_mps, seconds in ((0.5, 3.0), (-0.3, 1.0), (0.5, 3.0)):
        for _ in range(round(seconds / TICK_S)):
            world.step(TICK_S, speed_mps, 0.0)

    assert world.collisions == 2


def test_the_wheels_obey_their_acceleration_limits() -> None:
    world = World(seed=0)
    speeds = []
    for wanted in (0.9, 0.0):
        for _ in range(60):
            world.step(TICK_S, wanted, 0.0)
            speeds.append(world.speed_mps)

    changes = [(b - a) / TICK_S for a, b in itertools.pairwise(speeds)]
    assert max(changes) == pytest.approx(0.8)
    assert min(changes) == pytest.approx(-1.5)
    assert max(speeds) == pytest.approx(0.9)
    assert speeds[-1] == 0.0


def test_the_lidar_measures_walls_and_posts() -> None:
    world = World(seed=0)
    world.visible.append(Obstacle(world.x_m + 2.0, 0.0, 0.25, 9.0))
    ranges = world.scan()

    assert ranges.shape == (BEAMS,)
    left = int(np.abs(world.beam_angles - math.pi / 2).argmin())
    off_rad = world.beam_angles[left] - math.pi / 2
    assert ranges[left] == pytest.approx(world.width_m / 2 / math.cos(off_rad))
    ahead = int(np.abs(world.beam_angles).argmin())
    assert 1.75 <= ranges[ahead] < 1.77
    world.visible.clear()
    assert math.isinf(world.scan()[ahead])


def test_the_dead_man_brakes_a_moving_wheelchair_and_counts_one_stop() -> None:
    world, driver = World(seed=0), Driver()
    driver.command(0.0, 0.6, 0.0)
    ticks = round(3.0 / TICK_S)
    for tick in range(ticks):
        if tick * TICK_S < 1.0:
            driver.command(tick * TICK_S, 0.6, 0.0)
        world.step(TICK_S, *driver.wanted(tick * TICK_S, world.speed_mps))

    assert world.speed_mps == 0.0
    assert driver.stops == 1


def test_standing_still_without_commands_is_not_a_stop() -> None:
    world, driver = World(seed=0), Driver()
    for tick in range(100):
        world.step(TICK_S, *driver.wanted(tick * TICK_S, world.speed_mps))

    assert driver.stops == 0
    assert world.x_m == World(seed=0).x_m


def test_a_command_that_comes_back_before_standstill_is_not_a_stop() -> None:
    driver = Driver()
    driver.command(0.0, 0.6, 0.0)

    assert driver.wanted(0.2, 0.6) == (0.6, 0.0)
    assert driver.wanted(0.31, 0.6) == (0.0, 0.0)
    driver.command(0.4, 0.5, 0.1)
    assert driver.wanted(0.42, 0.3) == (0.5, 0.1)
    assert driver.stops == 0


def test_the_inhibit_switch_holds_the_wheels_against_fresh_commands() -> None:
    world, driver = World(seed=0), Driver()
    for tick in range(300):
        driver.command(tick * TICK_S, 0.6, 0.0)
        driver.inhibited = 100 <= tick < 200
        world.step(TICK_S, *driver.wanted(tick * TICK_S, world.speed_mps))
        if tick == 199:
            assert world.speed_mps == 0.0
            assert driver.stops == 1

    assert world.speed_mps == pytest.approx(0.6)
    assert driver.stops == 1


def test_the_law_keeps_nothing_between_two_plans() -> None:
    world = World(seed=1)
    pose = Pose(world.x_m, world.y_m, world.yaw_rad, 0.3, 0.0)
    used, fresh = Planner(*CLOUD), Planner(*CLOUD)
    used.plan(np.full(BEAMS, 0.5), world.beam_angles, pose, (5.0, 1.0))

    arguments = (world.scan(), world.beam_angles, pose, world.goal)
    assert used.plan(*arguments) == fresh.plan(*arguments)


def test_the_law_stops_at_the_goal_and_turns_to_a_goal_behind() -> None:
    nothing = np.full(BEAMS, np.inf)
    angles = World().beam_angles
    planner = Planner(*ROBOT)

    assert planner.plan(nothing, angles, Pose(9.9, 0.0, 0.0, 0.2, 0.0), (10.0, 0.0)) == (0.0, 0.0)
    speed, yaw_rate = planner.plan(nothing, angles, Pose(5.0, 0.0, math.pi - 0.1, 0.0, 0.0), (10.0, 0.0))
    assert speed == 0.0
    assert yaw_rate < 0.0


def test_a_corridor_too_short_for_a_start_and_a_goal_is_refused() -> None:
    with pytest.raises(ValueError, match="too short"):
        World(length_m=2.0)
