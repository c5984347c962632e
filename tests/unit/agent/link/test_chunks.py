"""Large messages in chunks: they arrive whole, one after the other, and leave room on the link."""

from __future__ import annotations

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_offload_agent.link.chunks import (
    CHUNK_BYTES,
    GIVE_UP_S,
    LEAST_CHUNKS,
    MOST_CHUNKS,
    PLACE,
    RECEIPT,
    STALL_S,
    Assembly,
    ChunkSender,
    Window,
    read_receipt,
    receipt,
)

STEP_S = 0.002


def acknowledge(sender: ChunkSender, attachment: bytes, now_s: float) -> bool:
    number, index, channel = read_receipt(receipt(attachment, "in/camera"))
    assert channel == "in/camera"
    return sender.acknowledged(number, index, now_s)


@given(st.integers(1, 12 * CHUNK_BYTES), st.integers(0, 2**32), st.floats(0, 0.5), st.integers(0, 3))
def test_a_message_arrives_whole_and_once_whatever_finds_no_room_in_the_queue(
    size: int, seed: int, lost: float, delay: int
) -> None:
    chance = random.Random(seed)
    payload = bytes(chance.randbytes(size))
    sender, assembly, now_s = ChunkSender(2**32 - 1), Assembly(), 0.0
    assert sender.offer(b"header", payload, now_s)
    on_its_way: list[tuple[float, bytes, bytes]] = []
    arrived = []
    while sender.present is not None:
        now_s += STEP_S if on_its_way else STALL_S
        assert now_s < 1000, "it comes to an end"
        while (chunk := sender.next(now_s)) is not None:
            if chance.random() >= lost:
                on_its_way.append((now_s + delay * STEP_S, *chunk))
        while on_its_way and on_its_way[0][0] <= now_s:
            _, attachment, part = on_its_way.pop(0)
            if (whole := assembly.take(attachment, part)) is not None:
                arrived.append(whole)
            acknowledge(sender, attachment, now_s)
    assert arrived == [(b"header", payload)] * (sender.given_up == 0)
    assert assembly.parts == {} or sender.given_up


def test_one_large_message_is_on_its_way_at_a_time_and_room_is_said_after_a_refusal() -> None:
    sender = ChunkSender(7)
    assert sender.offer(b"", bytes(CHUNK_BYTES + 1), 0.0)
    assert not sender.offer(b"", bytes(CHUNK_BYTES), 0.01)
    chunks = [sender.next(0.02), sender.next(0.02)]
    assert sender.next(0.02) is None
    rooms = [acknowledge(sender, chunk[0], 0.03) for chunk in chunks if chunk is not None]
    assert rooms == [False, True]
    assert sender.offer(b"", bytes(CHUNK_BYTES), 0.04)


def test_what_nobody_acknowledges_is_sent_again_and_given_up_in_the_end() -> None:
    sender = ChunkSender(7)
    assert sender.offer(b"", bytes(CHUNK_BYTES), 0.0)
    first = sender.next(0.0)
    assert sender.next(STALL_S / 2) is None
    assert sender.next(STALL_S) == first
    assert sender.next(STALL_S + 0.1) is None, "not at each look"
    assert sender.next(GIVE_UP_S) is None
    assert sender.given_up == 1
    assert not sender.is_busy()


def test_the_window_grows_while_nothing_waits_and_halves_once_for_a_queue() -> None:
    window = Window()
    for step in range(100):
        window.acknowledged(step * 0.01, step * 0.01 + 0.02)
    assert window.size == MOST_CHUNKS
    for step in range(10):  # all of them were on their way when the first was late
        window.acknowledged(1.0, 1.1 + step * 0.001)
    assert window.size == MOST_CHUNKS / 2
    for step in range(100):
        window.acknowledged(2.0 + step, 2.1 + step)
    assert window.size == LEAST_CHUNKS


def test_chunks_of_a_message_that_came_by_the_session_before_disturb_no_newer_one() -> None:
    assembly, payload = Assembly(), bytes(range(250)) * 300
    both = []
    for number in (5, 900):
        sender = ChunkSender(number)
        assert sender.offer(str(number).encode(), payload, 0.0)
        both.append([chunk for _ in range(2) if (chunk := sender.next(0.0)) is not None])
    found = [assembly.take(*chunk) for pair in zip(*both, strict=True) for chunk in pair]
    assert found == [None, None, (b"5", payload), (b"900", payload)]
    assert [assembly.take(*chunk) for chunk in both[0]] == [None, None], "sent once more"


@pytest.mark.parametrize(
    ("attachment", "payload"),
    [
        (b"", b""),
        (b"short", b""),
        (PLACE.pack(1, 0, 0), b""),
        (PLACE.pack(1, 3, 3), b""),
        (PLACE.pack(1, 0, 60_000), b""),
        (PLACE.pack(1, 0, 1), bytes(CHUNK_BYTES + 1)),
    ],
)
def test_what_is_no_chunk_is_refused_and_kept_nowhere(attachment: bytes, payload: bytes) -> None:
    assembly = Assembly()
    with pytest.raises(ValueError, match="bytes"):
        assembly.take(attachment, payload)
    assert assembly.parts == {}


def test_an_unknown_acknowledgement_changes_nothing() -> None:
    sender = ChunkSender(7)
    assert not sender.acknowledged(8, 0, 0.0)
    assert sender.offer(b"", bytes(3 * CHUNK_BYTES), 0.0)
    assert sender.next(0.0) is not None
    for number, index in ((9, 0), (8, 1), (8, 77)):
        assert not sender.acknowledged(number, index, 0.1)
    assert sender.present is not None
    assert len(sender.present.waiting) == 1
    with pytest.raises(ValueError, match="bytes"):
        read_receipt(b"x" * (RECEIPT.size - 1))


def test_few_messages_that_are_not_whole_are_kept() -> None:
    assembly = Assembly()
    for number in range(50):
        assert assembly.take(PLACE.pack(number, 0, 2), b"half") is None
    assert len(assembly.parts) == 2
