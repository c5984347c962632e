"""The times in force, in one sentence: those that follow from the profile, and those that are given."""

from __future__ import annotations

from robot_offload.insight.timing import timing


def test_without_a_word_the_times_are_those_of_the_balanced_profile() -> None:
    (told,) = timing({})
    assert told == (
        "switching.profile is Balanced: a heartbeat every 20 ms, a lost link after 90 ms, a lease of 250 ms, commands "
        "at most 150 ms old."
    )


def test_what_is_given_is_named_and_the_others_follow_from_it() -> None:
    (told,) = timing({"switching": {"profile": "Patient", "lossTimeout": "300ms"}})
    assert told.startswith("switching.profile is Patient, lossTimeout is given: a heartbeat every 50 ms")
    assert "a lost link after 300 ms" in told
    (told,) = timing({"switching": {"lossTimeout": "90ms", "lease": "250ms"}})
    assert "lossTimeout, lease are given" in told


def test_times_that_cannot_be_read_are_left_to_the_condition_that_refuses_them() -> None:
    assert list(timing({"switching": {"lease": "soon"}})) == []
    assert list(timing({"switching": ["x"]})) == []
