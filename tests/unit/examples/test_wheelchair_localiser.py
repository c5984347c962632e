"""The wheelchair's odometry drifts, its markers say how far, and the localiser's correction carries that on."""

import math

import pytest

from examples.wheelchair.place import Place
from examples.wheelchair.world import FIRST_MARKER_M, MARKER_EVERY_M, Markers, WheelOdometry, World

DRIFT = 0.05


def driven(metres: float, drift: float) -> tuple[World, WheelOdometry]:
    """A drive along the middle of the corridor."""
    world = World(seed=3)
    odometry = WheelOdometry(world, drift)
    while world.x_m < 1.0 + metres:
        world.step(0.02, 0.8, 0.0)
        odometry.follow(world)
    return world, odometry


def test_odometry_without_drift_is_true() -> None:
    world, odometry = driven(3.0, 0.0)
    assert (odometry.x_m, odometry.y_m, odometry.yaw_rad) == pytest.approx((world.x_m, world.y_m, world.yaw_rad))


def test_odometry_with_drift_is_wrong_by_five_percent_and_turns() -> None:
    world, odometry = driven(3.0, DRIFT)
    assert odometry.x_m - 1.0 == pytest.approx((world.x_m - 1.0) * 1.05, rel=1e-3)
    assert odometry.yaw_rad == pytest.approx(3.0 * DRIFT * 0.1, rel=0.02)
    assert odometry.y_m > 0.01


def test_each_marker_is_passed_once() -> None:
    markers = Markers()
    passed = [x_m / 10 for x_m in range(200) if markers.passed(x_m / 10)]
    assert passed == [pytest.approx(FIRST_MARKER_M + n * MARKER_EVERY_M) for n in range(3)]


def test_a_correction_made_at_a_marker_turns_odometry_into_the_place() -> None:
    world, odometry = driven(3.0, DRIFT)
    seen = Place(odometry.x_m, odometry.y_m, odometry.yaw_rad)
    true = Place(world.x_m, world.y_m, world.yaw_rad)
    correction = true.then(seen.inverse())
    found = correction.then(seen)
    assert (found.x_m, found.y_m, found.yaw_rad) == pytest.approx((true.x_m, true.y_m, true.yaw_rad))
    later = Place(seen.x_m + math.cos(seen.yaw_rad), seen.y_m + math.sin(seen.yaw_rad), seen.yaw_rad)
    ahead = correction.then(later)
    assert (ahead.x_m - true.x_m, ahead.y_m - true.y_m) == pytest.approx((1.0, 0.0), abs=1e-6)
