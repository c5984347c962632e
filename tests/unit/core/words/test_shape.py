"""The digest of what is numbered by its place."""

from robot_offload_core.words.beats import SHAPE_LENGTH
from robot_offload_core.words.shape import shape

SCAN, MAP, COMMAND, PLAN = (("scan", "/scan"), ("map", "/map"), ("command", "/cmd_vel"), ("plan", "/plan"))


def test_the_same_lists_have_one_shape_of_eight_digits() -> None:
    assert shape([SCAN, MAP], [COMMAND]) == shape((SCAN, MAP), (COMMAND,))
    assert len(shape([], [])) == SHAPE_LENGTH


def test_another_order_another_entry_and_another_topic_are_another_shape() -> None:
    others = [
        shape([SCAN, MAP], [COMMAND, PLAN]), shape([MAP, SCAN], [COMMAND, PLAN]), shape([SCAN, MAP], [PLAN, COMMAND]),
        shape([SCAN], [COMMAND, PLAN]), shape([SCAN, MAP], [COMMAND]), shape([("scan", "/s"), MAP], [COMMAND, PLAN]),
        shape([SCAN, MAP, COMMAND], [PLAN]),
    ]  # fmt: skip
    assert len(set(others)) == len(others)
