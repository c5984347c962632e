"""What the processes of an agent tell each other: every message survives its way, and nobody waits for anybody."""

import array
import contextlib
import random
import select
import socket
from dataclasses import is_dataclass, replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_offload_agent.runtime import bus, records
from robot_offload_agent.runtime.bus import MAX_INLINE, Bus
from robot_offload_agent.runtime.parcels import LARGEST_BYTES, TOTAL_BYTES, TOTAL_COUNT
from robot_offload_core.fence import envelope
from robot_offload_core.fence.token import Token
from robot_offload_core.words import beats, messages
from robot_offload_core.words.beats import CloudReport, Permission
from robot_offload_core.words.codec import CodecError, plain, typed
from robot_offload_core.words.messages import ENVELOPE, PASSED, Arrived, Carried, Fatal, Letters, PulseSent, Speak

HEADER = envelope.encode(envelope.Envelope(Token("ab" * 16, 3, "cd" * 16), 7, 8))


def of(kind: type) -> st.SearchStrategy[Any]:
    """Any value of a message type, built from its type hints."""
    return st.from_type(kind)


st.register_type_strategy(float, st.floats(allow_nan=False))


@pytest.mark.parametrize("name", bus.KINDS)
@given(data=st.data())
def test_every_kind_of_message_is_read_back_as_it_was(name: str, data: st.DataObject) -> None:
    message = data.draw(of(bus.KINDS[name]))
    assert typed(bus.KINDS[name], plain(message)) == message


@pytest.mark.parametrize("kind", [Arrived, Speak])
@given(data=st.data())
def test_what_is_said_with_every_beat_is_read_back_from_its_record(kind: type, data: st.DataObject) -> None:
    message = data.draw(of(kind))
    record = records.packed(message)
    assert record is None or records.unpacked(record) == message


def test_beats_and_permissions_have_records_and_what_does_not_fit_one_has_none() -> None:
    permission = Permission(7, True, "c" * 32, 250_000, in_charge=True, presence=True)
    assert records.packed(Speak("r" * 32, permission, 5.0)) is not None
    assert records.packed(Arrived("beat", 5.0, -3, PulseSent(4.9, True))) is not None
    assert records.packed(Speak("r" * 32, replace(permission, epoch=1 << 64), 5.0)) is None
    assert records.packed(Speak("r" * 256, permission, 5.0)) is None
    assert records.packed(Arrived("beat \N{HEAVY CHECK MARK}", 5.0, 0, None)) is None
    assert records.packed(Speak("r" * 32, CloudReport(), 5.0)) is None


@pytest.fixture
def pair(tmp_path: Path) -> Any:
    ends = Bus(tmp_path, "one"), Bus(tmp_path, "two")
    yield ends
    for end in ends:
        end.close()


def test_messages_arrive_in_order_and_typed(pair: tuple[Bus, Bus]) -> None:
    one, two = pair
    for number in range(3):
        assert one.send("two", Fatal("one", f"message {number}"))
    assert one.send("two", Speak("ab" * 16, beats.CloudReport(input_ages_us=(1, -1)), 5.0))
    assert [two.receive() for _ in range(3)] == [Fatal("one", f"message {n}") for n in range(3)]
    assert two.receive() == Speak("ab" * 16, beats.CloudReport(input_ages_us=(1, -1)), 5.0)
    assert two.receive() is None


@given(kind=st.sampled_from([ENVELOPE, PASSED]), index=st.integers(0, 65535), payload=st.binary())
def test_outputs_are_carried_with_header_and_payload(
    tmp_path_factory: pytest.TempPathFactory, kind: bytes, index: int, payload: bytes
) -> None:
    folder = tmp_path_factory.getbasetemp()
    one, two = Bus(folder, "a"), Bus(folder, "b")
    try:
        assert one.carry("b", kind, index, HEADER, payload)
        assert two.receive() == Carried(kind, index, HEADER, payload)
    finally:
        one.close()
        two.close()


GARBAGE = [
    b"x", b"m", b"m[]", b'm["Fatal"]', b'm["Nothing",[]]', b'm["Fatal",[1]]', b"m\xff", b'm["Egress",7]', b"",
    b"a", b"s", b"a" + bytes(8), b"a" + bytes(24) + b"\2", b"a" + bytes(25) + b"\xff", b"a" + b"\xff" * 8 + bytes(17),
    b"s" + bytes(24) + b"\x08\0", b"s" + bytes(25) + b"\1", b"s" + bytes(25) + b"\1\xff",
    b"s" + b"\xff" * 8 + bytes(18),
]  # fmt: skip


@pytest.mark.parametrize("garbage", GARBAGE)
def test_garbage_is_left_out_and_what_follows_is_read(pair: tuple[Bus, Bus], garbage: bytes) -> None:
    one, two = pair
    one.socket.sendto(garbage, str(two.folder / "two.sock"))
    one.send("two", Fatal("one", "after it"))
    assert two.receive() == Fatal("one", "after it")
    assert two.garbage == 1


@given(data=st.binary())
def test_every_datagram_is_a_message_or_garbage(tmp_path_factory: pytest.TempPathFactory, data: bytes) -> None:
    end = Bus(tmp_path_factory.getbasetemp(), "anyone")
    try:
        end.socket.sendto(data, str(end.folder / "anyone.sock"))
        assert isinstance(end.receive(), Carried | Letters | Arrived | Speak | None)
    finally:
        end.close()


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner, max_size=4),
    max_leaves=8,
)


@pytest.mark.parametrize("name", bus.KINDS)
@given(value=JSON)
def test_a_message_has_the_types_of_its_fields_or_is_refused(name: str, value: object) -> None:
    try:
        message = typed(bus.KINDS[name], value)
    except CodecError:
        return
    assert typed(bus.KINDS[name], plain(message)) == message


def test_a_receiver_that_is_absent_or_does_not_read_costs_its_sender_nothing(pair: tuple[Bus, Bus]) -> None:
    one, _ = pair
    assert not one.send("nobody", Fatal("one", ""))
    sent = [one.send("two", Fatal("one", "x" * 1000)) for _ in range(5000)]
    assert sent[0]
    assert not sent[-1]
    assert one.dropped == 1 + sent.count(False)


@pytest.mark.parametrize("size", [200, 60_000, 5_000_000])
def test_a_receiver_that_does_not_read_holds_up_no_other_receiver(pair: tuple[Bus, Bus], size: int) -> None:
    one, two = pair
    stopped = Bus(one.folder, "stopped")
    while one.dropped == 0 and not one.losses():
        one.carry("stopped", ENVELOPE, 0, HEADER, bytes(size), "camera", reliable=False)
    assert one.send("two", Fatal("one", "all is well here"))
    assert two.receive() == Fatal("one", "all is well here")
    stopped.close()


@pytest.mark.parametrize("size", [0, 1, MAX_INLINE, MAX_INLINE + 1, 1_000_000, LARGEST_BYTES])
def test_payloads_of_any_size_up_to_the_largest_arrive_whole(pair: tuple[Bus, Bus], size: int) -> None:
    one, two = pair
    payload = random.Random(size).randbytes(size)
    for _ in range(3):
        assert one.carry("two", PASSED, 5, HEADER, payload)
        assert two.receive() == Carried(PASSED, 5, HEADER, payload)


@pytest.mark.parametrize("size", [0, 200, 60_000, 5_000_000])
def test_letters_of_the_relays_arrive_whole(pair: tuple[Bus, Bus], size: int) -> None:
    letters = Letters(random.Random(size).randbytes(size))
    assert pair[0].send("two", letters)
    assert pair[1].receive() == letters


def test_a_larger_payload_is_refused_and_its_size_is_known(pair: tuple[Bus, Bus]) -> None:
    one, two = pair
    assert not one.carry("two", ENVELOPE, 0, HEADER, bytes(LARGEST_BYTES + 1), "camera")
    assert one.too_large == {"camera": LARGEST_BYTES + 1}
    assert two.receive() is None


def test_large_payloads_that_nobody_reads_are_bounded_and_the_oldest_of_best_effort_go_first(
    pair: tuple[Bus, Bus],
) -> None:
    one, two = pair
    size = LARGEST_BYTES // 2
    room = TOTAL_BYTES // size
    assert one.carry("two", ENVELOPE, 0, HEADER, bytes(size), "map", reliable=True)
    for number in range(room + 2):
        assert one.carry("two", ENVELOPE, 1, HEADER, bytes([number]) * size, "camera", reliable=False)
    assert sum(p.size for p in one.parcels.waiting) <= TOTAL_BYTES
    assert one.losses() == {"camera": 3}
    read = []
    while (message := two.receive()) is not None:
        read.append((message.index, message.payload[0]))
    assert read == [(0, 0), *((1, number) for number in range(3, room + 2))]
    assert one.carry("two", ENVELOPE, 0, HEADER, bytes(size), "map")
    assert len(one.parcels.waiting) == 1, "what was read takes no room"


def test_large_payloads_on_their_way_are_bounded_in_number_too(pair: tuple[Bus, Bus]) -> None:
    one, _ = pair
    for _ in range(TOTAL_COUNT + 3):
        one.carry("two", ENVELOPE, 0, HEADER, bytes(MAX_INLINE + 1), "scan")
    assert len(one.parcels.waiting) <= TOTAL_COUNT
    assert one.losses()["scan"] + one.dropped >= 3


def held() -> list[str]:
    """What this process has open; of other tests something may be closed meanwhile."""
    names = []
    for link in Path("/proc/self/fd").iterdir():
        with contextlib.suppress(FileNotFoundError):
            names.append(str(link.readlink()))
    return names


def test_files_that_come_with_garbage_are_closed(pair: tuple[Bus, Bus], tmp_path: Path) -> None:
    one, two = pair
    with (tmp_path / "some file").open("w+b") as file:
        rights = [(socket.SOL_SOCKET, socket.SCM_RIGHTS, array.array("i", [file.fileno()] * 3))]
        for datagram in (b"E", b"m{}", b"x", b"E" + bytes(2) + HEADER):
            one._open("two")[0].sendmsg([datagram], rights, 0, str(two.folder / "two.sock"))
        assert str(tmp_path / "some file") in held()
    assert two.receive() is None
    assert two.garbage == 4
    assert str(tmp_path / "some file") not in held()


def test_a_process_that_starts_again_takes_over_the_socket_of_its_predecessor(tmp_path: Path) -> None:
    sender, first = Bus(tmp_path, "sender"), Bus(tmp_path, "heir")
    heir = Bus(tmp_path, "heir")
    assert sender.send("heir", Fatal("sender", "hello"))
    assert heir.receive() == Fatal("sender", "hello")
    for end in (sender, first, heir):
        end.close()


def rings(receiver: Bus) -> bool:
    """Returns whether a process that waits for news is woken."""
    return bool(select.select([receiver.news], [], [], 0)[0])


def test_news_wakes_its_receiver_and_a_level_that_is_repeated_waits_for_it_in_order(pair: tuple[Bus, Bus]) -> None:
    one, two = pair
    assert one.renew("two", Fatal("one", "first"))
    assert not rings(two)
    assert one.send("two", Fatal("one", "second"))
    assert one.renew("two", Fatal("one", "third"))
    assert rings(two)
    assert [two.receive() for _ in range(4)] == [*(Fatal("one", n) for n in ("first", "second", "third")), None]
    assert not rings(two)
    assert one.carry("two", ENVELOPE, 0, HEADER, b"")
    assert rings(two)


def test_what_comes_while_a_row_is_read_is_read_or_rings_again(pair: tuple[Bus, Bus]) -> None:
    one, two = pair
    one.send("two", Fatal("one", "first"))
    assert two.receive() == Fatal("one", "first")
    one.send("two", Fatal("one", "second"))
    assert rings(two)
    assert two.receive() == Fatal("one", "second")
    assert two.receive() is None


def test_a_receiver_whose_inbox_fills_up_without_a_ring_waits_for_the_inbox_until_it_has_read_all(
    pair: tuple[Bus, Bus],
) -> None:
    one, two = pair
    for _ in range(2):
        while one.renew("two", Fatal("one", "garbage")):
            pass
        while two.receive() is not None:
            pass
    one.renew("two", Fatal("one", "more of it"))
    assert rings(two)
    assert two.receive() == Fatal("one", "more of it")
    assert two.receive() is None
    one.renew("two", Fatal("one", "a level"))
    assert not rings(two)


@pytest.mark.parametrize("large", [0, MAX_INLINE + 1])
def test_a_receiver_whose_inbox_is_full_is_woken(pair: tuple[Bus, Bus], large: int) -> None:
    one, two = pair
    while one.renew("two", Fatal("one", "a level")):
        pass
    assert not rings(two)
    one.carry("two", ENVELOPE, 0, HEADER, bytes(large))
    assert rings(two)


def test_every_message_of_the_core_can_be_sent() -> None:
    declared = {name for name, kind in vars(messages).items() if getattr(kind, "__module__", "") == messages.__name__}
    assert {name for name in declared if is_dataclass(vars(messages)[name])} - {
        "Carried",
        "Letters",
    } <= bus.KINDS.keys()
