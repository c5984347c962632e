"""Parameters as state: what crosses is whole and typed, and only what differs is set."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_offload_core.data import parameter_values
from robot_offload_core.data.parameter_values import Value, decode, encode
from robot_offload_core.fence.token import Site

TABLE: dict[str, Value] = {
    "go": (1, True),
    "count": (2, -(1 << 63)),
    "speed": (3, 0.5),
    "whole": (3, 2.0),
    "far": (3, float("inf")),
    "frame": (4, "map ü"),
    "bytes": (5, [0, 255]),
    "flags": (6, [True]),
    "counts": (7, []),
    "gains": (8, [1.0, 2.5]),
    "plugins": (9, ["a", ""]),
}


def test_every_type_of_parameter_comes_back_as_it_was() -> None:
    assert decode(encode({"controller": TABLE, "costmap/costmap": {}})) == {"controller": TABLE, "costmap/costmap": {}}
    reordered = dict(reversed(list(TABLE.items())))
    assert encode({"controller": TABLE}) == encode({"controller": reordered}), "what is equal is said equally"


@pytest.mark.parametrize(
    "value",
    [
        [0, None], [10, 1], [True, True], ["1", True], [1, 1], [2, True], [2, 1.0], [2, 1 << 63], [3, 1], [3, "1"],
        [4, 1], [5, [256]], [5, [-1]], [6, [1]], [7, [1.0]], [8, [1]], [9, [1]], [9, "a"], [1], [1, True, 0], {}, None,
    ],
)  # fmt: skip
def test_a_value_that_is_not_of_its_type_spoils_the_whole_message(value: object) -> None:
    assert decode(json.dumps({"controller": {"good": [1, True], "bad": value}}).encode()) is None


@pytest.mark.parametrize(
    "message",
    [
        b"", b"\xff", b"1" * 5000, b"[" * 100_000, b"null", b'{"a":[]}', json.dumps({"n" * 300: {}}).encode(),
        json.dumps({str(i): {} for i in range(33)}).encode(),
        json.dumps({"a": {str(i): [1, True] for i in range(4097)}}).encode(),
    ],
    ids=range(9),
)  # fmt: skip
def test_what_is_no_message_of_ours_is_nothing(message: bytes) -> None:
    assert decode(message) is None


@given(st.binary(max_size=200))
def test_no_bytes_end_the_process(message: bytes) -> None:
    decode(message)


def test_only_what_differs_and_exists_here_is_set() -> None:
    nan = float("nan")
    wanted: dict[str, Value] = {"same": (3, nan), "other": (2, 1), "kind": (2, 1), "new": (4, "x")}
    own: dict[str, Value] = {"same": (3, nan), "other": (2, 2), "kind": (3, 1.0), "mine": (1, True)}
    assert parameter_values.unlike(wanted, own) == {"other": (2, 1), "kind": (2, 1)}
    assert parameter_values.absent(wanted, own) == ["new"]


def test_private_topics_become_those_of_this_side() -> None:
    table: dict[str, Value] = {"topic": (4, "/offload/cloud/scan"), "topics": (9, ["/offload/cloud/a", "/b"])}
    expected = {"topic": (4, "/offload/robot/scan"), "topics": (9, ["/offload/robot/a", "/b"])}
    assert parameter_values.here(table, Site.ROBOT) == expected


def test_what_was_refused_is_named_and_many_are_counted() -> None:
    assert parameter_values.sentence([]) == ""
    assert parameter_values.sentence(["a.b (read-only)"]) == "the replica did not take a.b (read-only)"
    assert parameter_values.sentence([f"a.{i} (no)" for i in range(10)]).endswith("a.7 (no) and 2 more")
