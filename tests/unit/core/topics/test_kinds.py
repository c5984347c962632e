"""A declared type that differs from the graph's is named, with who publishes the other one."""

from __future__ import annotations

from robot_offload_core.words.topic_kinds import otherwise

FLOATS, TEXT = "std_msgs/msg/Float32MultiArray", "std_msgs/msg/String"


def test_a_type_that_differs_from_the_declared_one_is_named_with_its_publisher() -> None:
    assert otherwise("/boxes", FLOATS, [("/detector", TEXT), ("/other", FLOATS)]) == (
        "TypesDiffer",
        f"/boxes is declared as {FLOATS}, but /detector publishes {TEXT}: correct the declaration or the node",
    )


def test_what_was_declared_or_left_open_is_no_problem() -> None:
    assert otherwise("/boxes", FLOATS, [("/detector", FLOATS)]) is None
    assert otherwise("/boxes", "auto", [("/detector", TEXT)]) is None
    assert otherwise("/boxes", FLOATS, []) is None
