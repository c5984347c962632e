"""What the relays write: read strictly, refused with a reason, never an exception of another kind."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_offload_core.fence.token import Site, Token
from robot_offload_core.relay.goals import words
from robot_offload_core.relay.goals.courier import WINDOW, Courier
from robot_offload_core.relay.goals.ports import Face, GoalStatus
from robot_offload_core.relay.goals.words import CallVerdict, RelayFrame, WordError

NUMBERS = st.integers(0, 2**64 - 1)
INCARNATIONS = st.text("0123456789abcdef", min_size=32, max_size=32).filter(lambda text: text.strip("0") != "")
TOKENS = st.builds(Token, INCARNATIONS | st.just(""), NUMBERS, INCARNATIONS | st.just(""))
NAMES = st.text(max_size=40)
FORMS: dict[Any, st.SearchStrategy[Any]] = {
    str: NAMES, int: NUMBERS, bool: st.booleans(), bytes: st.binary(max_size=100), Token: TOKENS,
    Site: st.sampled_from(Site), Face: st.sampled_from(Face), GoalStatus: st.sampled_from(GoalStatus),
    CallVerdict: st.sampled_from(CallVerdict), tuple[str, ...]: st.lists(NAMES, max_size=5).map(tuple),
    tuple[int, ...]: st.lists(NUMBERS, max_size=5).map(tuple),
}  # fmt: skip


def word_of(kind: type[Any]) -> st.SearchStrategy[Any]:
    names = kind.__dataclass_fields__
    fields = {
        name: st.binary(min_size=16, max_size=16) if name == "attempt" else FORMS[form]
        for name, form in zip(names, words._FORMS[kind], strict=True)
    }
    return st.builds(kind, **fields)


FRAMES = st.builds(RelayFrame, INCARNATIONS, INCARNATIONS | st.just(""), NUMBERS, st.one_of(map(word_of, words.KINDS)))


@given(FRAMES)
def test_what_was_written_is_read(frame: RelayFrame) -> None:
    assert words.decode(words.encode(frame)) == frame


@given(st.binary(max_size=300) | st.builds(lambda f, cut, more: words.encode(f)[:cut] + more, FRAMES,
                                           st.integers(0, 200), st.binary(max_size=20)))  # fmt: skip
def test_anything_else_is_refused_with_a_reason(data: bytes) -> None:
    try:
        frame: RelayFrame | None = words.decode(data)
        reason = ""
    except WordError as error:
        frame, reason = None, error.reason
    assert (frame is None) is (reason in ("BadForm", "OtherVersion"))
    assert frame is None or words.encode(frame) == data


def test_another_version_is_said_to_be_one() -> None:
    frame = words.encode(RelayFrame("1" * 32, "", 0, words.Ack((1,))))
    with pytest.raises(WordError) as caught:
        words.decode(frame[:3] + b"\x07" + frame[4:])
    assert caught.value.reason == "OtherVersion"


@given(st.lists(st.tuples(st.integers(0, 3), st.integers(0, 40)), max_size=200))
def test_letters_arrive_once_whatever_is_lost_doubled_or_reordered(dice: list[tuple[int, int]]) -> None:
    """0 writes, 1 loses a frame, 2 delivers one out of turn, 3 delivers one and keeps a copy on the way."""
    ends = [Courier("1" * 32), Courier("2" * 32)]
    ends[0].meet("2" * 32)
    ends[1].meet("1" * 32)
    now, written = 0.0, 0
    way: list[bytes] = []
    taken: list[Any] = []

    def deliver(frame: bytes) -> None:
        read = words.decode(frame)
        to = ends[1] if read.writer == ends[0].mine else ends[0]
        word = to.take(read)
        if word is not None:
            taken.append(word)
        way.extend(ends[1].due(now))

    for kind, which in dice:
        now += 0.03
        way += ends[0].due(now)
        if kind == 0:
            written += 1
            way += ends[0].write(words.CancelWord(Face.GROUP, str(written), bytes(16)), now)
        elif way and kind == 1:
            way.pop(which % len(way))
        elif way:
            frame = way[which % len(way)]
            if kind == 2:
                way.remove(frame)
            deliver(frame)
    for _ in range(8):
        now += 0.2
        way += ends[0].due(now)
        while way:
            deliver(way.pop(0))
    assert sorted(int(word.action) for word in taken) == list(range(1, written + 1))
    assert not ends[0].letters


def test_a_letter_behind_the_window_is_refused_and_none_is_sent_so_far_ahead() -> None:
    one, two = Courier("1" * 32), Courier("2" * 32)
    one.meet("2" * 32)
    two.meet("1" * 32)
    word = words.CancelWord(Face.GROUP, "/a", bytes(16))
    frames = [frame for _ in range(WINDOW + 10) for frame in one.write(word, 0.0)]
    assert len(frames) == WINDOW
    for frame in frames[1:]:
        two.take(words.decode(frame))
    two.highest = WINDOW + 10
    assert two.take(words.decode(frames[0])) is None
