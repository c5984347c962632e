"""The header of carried messages: bytes out and in, and the age that needs no second clock."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_offload_core.fence import envelope
from robot_offload_core.fence.envelope import LAYOUT, MAGIC, Envelope, EnvelopeError
from robot_offload_core.fence.token import Token
from tests.unit.core.builders import CLOUD, NOW_S, ROBOT, many, us

words = st.integers(0, 2**64 - 1)
incarnations = st.one_of(
    st.just(""),
    st.text("0123456789abcdef", min_size=32, max_size=32).filter(lambda digits: digits.strip("0") != ""),
)
envelopes = st.builds(Envelope, st.builds(Token, incarnations, words, incarnations), words, words)


@many
@given(envelopes)
def test_a_header_is_read_back_as_it_was_written(header: Envelope) -> None:
    data = envelope.encode(header)
    assert len(data) == LAYOUT.size == 60
    assert envelope.decode(data) == header


@many
@given(st.binary(max_size=200))
def test_random_bytes_raise_nothing_but_an_envelope_error(data: bytes) -> None:
    with pytest.raises(EnvelopeError):
        envelope.decode(data)


@many
@given(st.binary(min_size=56, max_size=56), st.integers(0, 1))
def test_any_bytes_behind_the_magic_and_the_flag_are_some_header(data: bytes, flag: int) -> None:
    whole = MAGIC + bytes([flag]) + data
    assert envelope.encode(envelope.decode(whole)) == whole


@pytest.mark.parametrize("flags", [2, 3, 255])
def test_flags_of_another_version_are_refused(flags: int) -> None:
    with pytest.raises(EnvelopeError, match="version"):
        envelope.decode(MAGIC + bytes([flags]) + bytes(56))


@many
@given(envelopes, st.integers(0, 59))
def test_a_truncated_header_is_refused(header: Envelope, length: int) -> None:
    with pytest.raises(EnvelopeError, match="instead of 60"):
        envelope.decode(envelope.encode(header)[:length])


@many
@given(envelopes, st.binary(min_size=1, max_size=8))
def test_a_header_with_a_tail_is_refused(header: Envelope, tail: bytes) -> None:
    with pytest.raises(EnvelopeError, match="instead of 60"):
        envelope.decode(envelope.encode(header) + tail)


@many
@given(envelopes, st.binary(min_size=4, max_size=4).filter(lambda magic: magic != MAGIC))
def test_an_unknown_version_is_refused(header: Envelope, magic: bytes) -> None:
    with pytest.raises(EnvelopeError, match="version"):
        envelope.decode(magic + envelope.encode(header)[4:])


def test_the_age_counts_from_our_own_beat_that_the_sender_had_heard() -> None:
    header = Envelope(Token(ROBOT, 4, CLOUD), 17, us(NOW_S - 0.040))
    assert header.age_s(NOW_S) == pytest.approx(0.040)


def test_the_age_has_no_bound_when_the_sender_had_heard_nothing() -> None:
    assert Envelope(Token(ROBOT, 4, CLOUD), 17, 0).age_s(NOW_S) == float("inf")
