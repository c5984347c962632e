"""The agent knows how much of the robot's computer it takes, and says so when that is more than a tenth."""

from __future__ import annotations

import pytest

from robot_offload_core.control.weight import WINDOW_S, Weight, problem, read, share


def after(seconds: int, cores_used: float, weight: Weight | None = None, begun_s: float = 100.0) -> Weight:
    """Readings once a second of an agent that uses so much of one core."""
    weight = weight or Weight()
    used_s = weight.readings[-1][1] if weight.readings else 5.0
    for second in range(seconds + 1):
        weight = read(weight, used_s + cores_used * second, begun_s + second)
    return weight


@pytest.mark.parametrize(("cores_used", "cores", "expected"), [(0.2, 4, 0.05), (0.46, 2, 0.23), (0.0, 4, 0.0)])
def test_the_share_is_that_of_all_cores_in_the_last_minute(cores_used: float, cores: int, expected: float) -> None:
    assert share(after(60, cores_used), cores) == pytest.approx(expected)
    assert share(after(3600, cores_used), cores) == pytest.approx(expected)


def test_before_a_minute_has_passed_the_share_is_unknown() -> None:
    assert share(Weight(), 4) is None
    assert share(after(59, 3.0), 4) is None
    assert problem(after(59, 3.0), 4) is None


@pytest.mark.parametrize(("cores_used", "cores", "heavy"), [(0.4, 4, False), (0.41, 4, True), (0.21, 2, True)])
def test_more_than_a_tenth_of_the_computer_is_a_problem(cores_used: float, cores: int, heavy: bool) -> None:
    assert (problem(after(60, cores_used), cores) is not None) is heavy


def test_the_message_names_the_share_in_tenths_and_what_takes_less() -> None:
    found = problem(after(90, 0.46), 2)
    assert found is not None
    assert found[0] == "AgentHeavy"
    assert "more than 20% of this computer's processor (2 cores)" in found[1]
    assert "switching.heartbeatPeriod" in found[1]
    assert found == problem(after(90, 0.58), 2)


def test_a_peak_of_some_seconds_is_none() -> None:
    calm = after(60, 0.1)
    assert problem(after(5, 0.9, calm, begun_s=160.0), 4) is None


def test_the_end_of_a_heavy_minute_ends_the_problem() -> None:
    heavy = after(60, 0.9)
    assert problem(after(61, 0.1, heavy, begun_s=160.0), 4) is None


def test_a_process_that_is_started_anew_counts_from_zero() -> None:
    heavy = after(60, 0.9)
    again = read(heavy, 1.0, 161.0)
    assert again.readings == ((161.0, 1.0),)
    assert share(again, 4) is None


def test_the_memory_of_readings_is_bounded_when_they_are_late_or_stop_for_an_hour() -> None:
    weight = after(600, 0.2)
    assert len(weight.readings) <= WINDOW_S + 2
    late = read(weight, weight.readings[-1][1] + 0.2 * 3600, 4300.0)
    assert len(late.readings) == 2
    assert share(late, 2) == pytest.approx(0.1)
