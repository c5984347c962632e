"""A process that did not run for a while must not take what waited for new."""

from robot_offload_core.topics.pauses import DRAIN_S, LIMIT_S, Pauses


def test_a_process_that_runs_all_the_time_takes_everything_for_new() -> None:
    pauses = Pauses(10.0)
    assert not any(pauses.waited(10.0 + step * 0.9 * LIMIT_S) for step in range(1, 20))


def test_what_is_handled_just_after_a_pause_has_waited_and_what_comes_later_has_not() -> None:
    pauses = Pauses(10.0)
    resumed_s = 10.0 + LIMIT_S + 0.5
    assert pauses.waited(resumed_s)
    assert pauses.waited(resumed_s + 0.9 * DRAIN_S)
    assert not pauses.waited(resumed_s + 1.1 * DRAIN_S)


def test_what_is_handled_just_after_a_pause_has_waited_for_as_long_as_it_lasted_at_most() -> None:
    pauses = Pauses(10.0)
    assert pauses.at_most_s(10.05) == 0.0
    resumed_s = 10.05 + LIMIT_S + 0.5
    assert pauses.at_most_s(resumed_s) >= LIMIT_S + 0.5
    assert pauses.at_most_s(resumed_s + 0.9 * DRAIN_S) >= LIMIT_S + 0.5 + 0.9 * DRAIN_S
    assert pauses.at_most_s(resumed_s + 1.1 * DRAIN_S) == 0.0


def test_a_second_pause_is_noticed_as_well() -> None:
    pauses = Pauses(10.0)
    pauses.waited(11.0)
    pauses.waited(11.1)
    assert pauses.waited(12.0)
