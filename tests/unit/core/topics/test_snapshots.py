"""Snapshots: whole ones are taken in order, everything else is refused with the reason; ages are upper bounds."""

from __future__ import annotations

import struct
import zlib
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_offload_core.fence.envelope import Envelope
from robot_offload_core.fence.token import Token
from robot_offload_core.topics.snapshots import FORMAT, HEADER, MAGIC, Refused, Snapshot, Standing, parse, take
from robot_offload_state.packing import SnapshotError, pack, unpack
from tests.unit.core.builders import CLOUD, ROBOT, many

MEBIBYTE = 1 << 20
TOKEN = Token(ROBOT, 4, CLOUD)


def message(data: bytes) -> bytes:
    """A serialized UInt8MultiArray, as the middleware gives it."""
    cdr = b"\x00\x01\x00\x00" + struct.pack("<3I", 0, 0, len(data)) + data
    return cdr + bytes(-len(cdr) % 4)


def opened(sequence: int, epoch: int = 4, echo_us: int = 0, robot: str = ROBOT) -> Envelope:
    return Envelope(replace(TOKEN, epoch=epoch, robot=robot), sequence, echo_us)


@many
@given(st.integers(0, 2**32 - 1), st.binary(max_size=200))
def test_what_a_node_packs_is_what_the_agents_and_its_replica_read(version: int, data: bytes) -> None:
    packed = pack(version, data)
    assert parse(message(packed), MEBIBYTE) == Snapshot(version, data)
    assert unpack(packed) == (version, data)


@many
@given(st.binary(min_size=1, max_size=60), st.data())
def test_a_snapshot_with_any_bit_turned_is_refused(data: bytes, draw: st.DataObject) -> None:
    packed = bytearray(pack(7, data))
    bit = draw.draw(st.integers(0, len(packed) * 8 - 1))
    packed[bit // 8] ^= 1 << bit % 8
    version = range(6, 10)  # the node's own version carries no checksum: any is as good as another
    if bit // 8 not in version:
        assert isinstance(parse(message(bytes(packed)), MEBIBYTE), Refused)
        with pytest.raises(SnapshotError):
            unpack(bytes(packed))


@many
@given(st.binary(max_size=80), st.integers(0, 100))
def test_bytes_from_anybody_are_refused_and_never_an_error(garbage: bytes, size: int) -> None:
    assert isinstance(parse(garbage, size), Refused)
    assert isinstance(parse(message(garbage), size), Refused)


def test_each_refusal_says_why() -> None:
    whole = pack(1, b"state")
    newer_header = HEADER.pack(MAGIC, FORMAT + 1, 1, 5, zlib.crc32(b"state")) + b"state"
    dimensions = message(whole)[:4] + struct.pack("<I", 1) + message(whole)[8:]
    assert parse(message(whole), 5) == Snapshot(1, b"state")
    assert parse(message(whole), 4) is Refused.TOO_LARGE
    assert parse(message(whole[:-1]), 5) is Refused.TORN
    assert parse(message(whole + b"x"), 6) is Refused.TORN
    assert parse(message(newer_header), 5) is Refused.OTHER_FORMAT
    assert parse(message(b"pickle"), 5) is Refused.FOREIGN
    assert parse(message(whole)[:-6], 5) is Refused.FOREIGN
    assert parse(dimensions, 5) is Refused.FOREIGN


def test_snapshots_are_taken_in_order_only() -> None:
    standing = take(Standing(), opened(7), 10.0)
    assert isinstance(standing, Standing)
    for older in (opened(7), opened(6), opened(9, epoch=3)):
        assert take(standing, older, 11.0) is Refused.OLDER
    for newer in (opened(8), opened(1, epoch=5)):
        assert isinstance(take(standing, newer, 11.0), Standing)


def test_epochs_of_another_life_of_control_are_not_compared() -> None:
    standing = take(Standing(), opened(7, epoch=9), 10.0)
    assert isinstance(standing, Standing)
    assert isinstance(take(standing, opened(1, epoch=1, robot="b" * 32), 11.0), Standing)


@many
@given(st.floats(0, 5), st.floats(0, 5), st.floats(0, 100))
def test_the_age_bounds_the_true_one(link_s: float, heard_s: float, later_s: float) -> None:
    """Sent at 50 s, with the newest beat of ours that had been heard `heard_s` before; it travelled `link_s`."""
    arrived_s = 50.0 + link_s
    standing = take(Standing(), opened(1, echo_us=round((50.0 - heard_s) * 1e6)), arrived_s)
    assert isinstance(standing, Standing)
    assert standing.aged_s(arrived_s + later_s) >= link_s + later_s - 1e-5
    assert Standing().aged_s(50.0) == float("inf")
