"""What the processes of an agent tell each other: every message survives its way, and nobody waits for anybody."""

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_offload_agent.process import bus
from robot_offload_agent.process.bus import MAX_DATAGRAM, Bus, plain, typed
from robot_offload_core import beats, envelope
from robot_offload_core.process.messages import ENVELOPE, PASSED, Carried, Fatal, Speak
from robot_offload_core.token import Token

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


GARBAGE = [b"x", b"m", b"m[]", b'm["Fatal"]', b'm["Nothing",[]]', b'm["Fatal",[1]]', b"m\xff", b'm["Egress",7]', b""]


@pytest.mark.parametrize("garbage", GARBAGE)
def test_garbage_is_left_out_and_what_follows_is_read(pair: tuple[Bus, Bus], garbage: bytes) -> None:
    one, two = pair
    one.socket.sendto(garbage, str(two.folder / "two.sock"))
    one.send("two", Fatal("one", "after it"))
    assert two.receive() == Fatal("one", "after it")


def test_a_receiver_that_is_absent_or_does_not_read_costs_its_sender_nothing(pair: tuple[Bus, Bus]) -> None:
    one, _ = pair
    assert not one.send("nobody", Fatal("one", ""))
    sent = [one.send("two", Fatal("one", "x" * 1000)) for _ in range(5000)]
    assert sent[0]
    assert not sent[-1]
    assert one.dropped == 1 + sent.count(False)


def test_the_largest_payload_passes_and_a_larger_one_is_refused(pair: tuple[Bus, Bus]) -> None:
    one, two = pair
    assert one.carry("two", ENVELOPE, 0, HEADER, bytes(MAX_DATAGRAM - len(HEADER) - 3))
    carried = two.receive()
    assert isinstance(carried, Carried)
    assert len(carried.payload) == MAX_DATAGRAM - len(HEADER) - 3
    assert not one.carry("two", ENVELOPE, 0, HEADER, bytes(MAX_DATAGRAM - len(HEADER) - 2))


def test_a_process_that_starts_again_takes_over_the_socket_of_its_predecessor(tmp_path: Path) -> None:
    sender, first = Bus(tmp_path, "sender"), Bus(tmp_path, "heir")
    heir = Bus(tmp_path, "heir")
    assert sender.send("heir", Fatal("sender", "hello"))
    assert heir.receive() == Fatal("sender", "hello")
    for end in (sender, first, heir):
        end.close()
