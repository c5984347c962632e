"""Transforms in the bytes of a TFMessage: read, left out, and garbage refused."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_offload_core.topics import transforms
from robot_offload_core.topics.transforms import TransformsError
from tests.unit.core.builders import many

frames = st.text("abcdefghijklmnopqrstuvwxyz_/", min_size=1, max_size=20)
trees = st.lists(st.tuples(frames, frames, st.integers(0, 2**31 - 1), st.floats(-9, 9)), max_size=6)


def message(transforms_: list[tuple[str, str, int, float]], order: str = "<") -> bytes:
    """A TFMessage as a middleware writes it, by an account of the layout of its own."""
    data = struct.pack(f"{order}I", len(transforms_))
    for parent, child, second, x in transforms_:
        data += b"\0" * (-len(data) % 4) + struct.pack(f"{order}iI", second, 7)
        for text in (parent.encode() + b"\0", child.encode() + b"\0"):
            data += b"\0" * (-len(data) % 4) + struct.pack(f"{order}I", len(text)) + text
        data += b"\0" * (-len(data) % 8) + struct.pack(f"{order}7d", x, 0, 0, 0, 0, 0, 1)
    return (b"\0\1" if order == "<" else b"\0\0") + b"\0\0" + data


def names(payload: bytes) -> list[tuple[str, str]]:
    return [(t.parent, t.child) for t in transforms.read(payload)]


@pytest.mark.parametrize("order", ["<", ">"])
def test_the_frames_of_a_message_are_read_without_a_leading_slash(order: str) -> None:
    payload = message([("map", "odom", 1, 0.5), ("/odom", "base_link", 2, 1.5)], order)
    assert names(payload) == [("map", "odom"), ("odom", "base_link")]


@many
@given(trees, st.sampled_from("<>"))
def test_a_message_with_transforms_left_out_is_the_message_that_never_had_them(
    tree: list[tuple[str, str, int, float]], order: str
) -> None:
    kept = tree[::2]
    wanted = iter([place % 2 == 0 for place in range(len(tree))])
    assert transforms.only(message(tree, order), lambda _: next(wanted)) == (message(kept, order) if kept else None)


@many
@given(st.binary(max_size=400))
def test_garbage_raises_nothing_but_its_own_error(data: bytes) -> None:
    for payload in (data, b"\0\1\0\0" + data):
        try:
            transforms.read(payload)
        except TransformsError:
            continue


@many
@given(trees, st.data())
def test_a_torn_message_is_refused_or_read_in_part(
    tree: list[tuple[str, str, int, float]], data: st.DataObject
) -> None:
    payload = message(tree)
    torn = payload[: data.draw(st.integers(0, len(payload)))]
    if len(torn) < len(payload):
        with pytest.raises(TransformsError):
            transforms.read(torn)
