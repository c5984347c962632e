import pytest

from robot_offload_lab.bench.analysis import commanded
from robot_offload_lab.bench.groups.commanded import CASE
from tests.unit.lab.bench.stories import active, answered, arrivals, every, recording


def to_the_robot() -> tuple:
    """The cloud every 20 ms until the robot's first message at 102.04 s; asked at 102.0 s, Active at 102.01 s."""
    cloud = arrivals("cloud", 1, [*every(101.0, 102.0, 0.02), 102.0, 102.02])
    robot = arrivals("robot", 1, every(102.04, 103.0, 0.05))
    return recording(cloud, robot), [answered(102.0 - 0.001, "robot"), active(102.01)]


def test_a_commanded_switch_is_taken_apart_into_activation_timer_phase_and_gap():
    run, seen = to_the_robot()
    (switch,) = commanded.switches(run, seen, [])
    assert switch.to == "robot"
    assert switch.answer_ms == pytest.approx(2.0)
    assert switch.activation_ms == pytest.approx(11.0)
    assert switch.phase_ms == pytest.approx(30.0)
    assert switch.gap_ms == pytest.approx(20.0)


def test_the_gap_counts_silence_that_began_before_the_asking():
    cloud = arrivals("cloud", 1, [101.0, 101.95])
    run = recording(cloud, arrivals("robot", 1, [102.03]))
    (switch,) = commanded.switches(run, [answered(102.0, "robot")], [])
    assert switch.gap_ms == pytest.approx(80.0)
    assert switch.activation_ms is None


def test_an_event_heard_after_the_first_message_gives_no_negative_phase():
    run, _ = to_the_robot()
    (switch,) = commanded.switches(run, [answered(102.0, "robot"), active(102.041)], [])
    assert switch.activation_ms is None
    assert switch.phase_ms is None


def test_a_switch_whose_new_side_was_never_heard_is_left_out():
    run = recording(arrivals("cloud", 1, every(101.0, 103.0, 0.02)))
    assert commanded.switches(run, [answered(102.0, "robot")], []) == ()


def test_faults_are_counted_over_the_whole_run():
    cloud = arrivals("cloud", 1, every(101.0, 102.0, 0.02))
    lost = [a for a in cloud if a.sequence != 20]
    twice = arrivals("cloud", 5, [101.5])
    old = arrivals("robot", 1, [102.05], age_s=0.2)
    found = commanded.outcome(CASE, "realtime", recording(lost, twice, old), [answered(102.0, "robot")], [])
    faults = found.figures[0]
    assert faults.value == 3
    assert faults.note.startswith("1 duplicates, 0 reordered, 1 stale, 1 lost of 51 messages")


def test_the_limits_follow_the_slower_period():
    run, seen = to_the_robot()
    gap = commanded.outcome(CASE, "normal", run, seen, []).figures[1]
    assert (gap.must, gap.aim, gap.count) == (60.0, 53.0, 1)
    assert gap.met(gap.aim)
