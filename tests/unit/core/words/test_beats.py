"""The text of beats: what is written is read back, and nothing else gets past the reader."""

from __future__ import annotations

import string
from collections.abc import Callable
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_offload_core.fence.token import Site
from robot_offload_core.words import beats
from robot_offload_core.words.beats import (
    MAX_AGE_MS,
    MAX_INTEGER,
    MAX_LENGTH,
    Beat,
    BeatError,
    CloudReport,
    Echo,
    Permission,
)
from tests.unit.core.builders import CLOUD, ROBOT, UID, cloud_beat, many, report, robot_beat

incarnations = st.text("0123456789abcdef", min_size=32, max_size=32)
addressed = st.one_of(st.just(""), incarnations)
counts = st.integers(0, MAX_INTEGER - 1)
ages = st.integers(-1, MAX_INTEGER - 1)
echoes = st.one_of(st.none(), st.builds(Echo, incarnations, counts, counts, counts))
grants = st.sampled_from(
    [(False, False, False), (True, False, True), (True, True, True), (False, False, True)]
)  # a grant to act contains presence
permissions = st.builds(
    lambda epoch, grant, cloud, lease_us: Permission(epoch, grant[0], cloud, lease_us, *grant[1:]),
    counts, grants, addressed, counts,
)  # fmt: skip
written_ages = st.one_of(st.just(-1), st.integers(0, MAX_AGE_MS).map(lambda age_ms: age_ms * 1000))
reports = st.builds(
    CloudReport, addressed, counts, st.booleans(), st.booleans(), addressed, written_ages,
    st.lists(written_ages, max_size=12).map(tuple), st.integers(0, 2**beats.MAX_BITS - 1),
    st.one_of(st.just(""), st.text("0123456789abcdef", min_size=8, max_size=8)),
)  # fmt: skip
uids = st.text(string.ascii_letters + string.digits + "._-", min_size=1, max_size=63)
walls = st.integers(-MAX_INTEGER, MAX_INTEGER - 1)


def beats_of(
    side: Site, bodies: st.SearchStrategy[Permission] | st.SearchStrategy[CloudReport]
) -> st.SearchStrategy[Beat]:
    return st.builds(
        Beat, uids, st.just(side), addressed, counts, counts, walls, ages, echoes, st.one_of(st.none(), bodies)
    )


any_beat = st.one_of(beats_of(Site.ROBOT, permissions), beats_of(Site.CLOUD, reports))


@many
@given(any_beat)
def test_a_beat_is_read_back_as_it_was_written(beat: Beat) -> None:
    assert beats.decode(beats.encode(beat)) == beat


@many
@given(any_beat)
def test_a_beat_is_printable_ascii_of_one_line(beat: Beat) -> None:
    text = beats.encode(beat)
    assert text.isascii()
    assert text.isprintable()
    assert len(text) <= MAX_LENGTH


def read(text: str) -> Beat | None:
    """The beat, or None for a BeatError with a known reason; any other exception is the test's failure."""
    reason = ""
    try:
        return beats.decode(text)
    except BeatError as error:
        reason = error.reason
    assert reason in ("BadVersion", "BadForm")
    return None


@many
@given(st.text(max_size=1200))
def test_random_text_raises_nothing_but_a_beat_error(text: str) -> None:
    assert read(text) is None


@many
@given(st.lists(st.text("0123456789abcdef-,. rc\u0661\u00b2", max_size=40), max_size=30))
def test_random_words_of_a_beats_own_alphabet_raise_nothing_but_a_beat_error(words: list[str]) -> None:
    read(" ".join(["1", UID, "c", *words]))


@many
@given(any_beat, st.data())
def test_a_truncated_beat_is_refused_or_lacks_its_end_only(beat: Beat, data: st.DataObject) -> None:
    text = beats.encode(beat)
    shorter = read(text[: data.draw(st.integers(0, len(text) - 1))])
    if shorter is not None:  # whole words were left: who sent it, and when, is never in doubt
        assert replace(shorter, echo=beat.echo, body=beat.body) == beat
        assert (shorter.echo is None) == (beat.echo is None)


@many
@given(any_beat, st.data())
def test_one_changed_character_raises_nothing_but_a_beat_error(beat: Beat, data: st.DataObject) -> None:
    text = beats.encode(beat)
    place = data.draw(st.integers(0, len(text) - 1))
    read(text[:place] + data.draw(st.characters()) + text[place + 1 :])


def read_by(text: str, how: Callable[[str], Beat]) -> Beat | tuple[str, str]:
    """What a text is read as: a beat, or why it is none."""
    try:
        return how(text)
    except BeatError as error:
        return error.reason, str(error)


@many
@given(any_beat, st.lists(st.tuples(st.integers(0, 400), st.sampled_from(["", *"0123456789abcdef-, rc"])), max_size=3))
def test_the_short_way_of_reading_reads_what_the_long_way_reads(beat: Beat, changes: list[tuple[int, str]]) -> None:
    text = beats.encode(beat)
    for place, character in changes:
        text = text[: place % len(text)] + character + text[place % len(text) + (place % 2) :] or " "
    assert read_by(text, beats.decode) == read_by(text, beats._word_by_word)


@many
@given(
    st.text(min_size=1).filter(lambda version: version not in (beats.VERSION, beats.PREVIOUS) and " " not in version)
)
def test_an_unknown_version_is_told_apart_from_garbage(version: str) -> None:
    _, rest = beats.encode(cloud_beat()).split(" ", 1)
    with pytest.raises(BeatError) as caught:
        beats.decode(f"{version} {rest}"[:MAX_LENGTH])
    assert caught.value.reason == "BadVersion"


def test_the_empty_frame_id_of_a_bare_header_is_no_beat() -> None:
    with pytest.raises(BeatError, match="BadVersion"):
        beats.decode("")


def test_text_over_the_length_limit_is_refused_unread() -> None:
    text = beats.encode(cloud_beat())
    with pytest.raises(BeatError, match="too long"):
        beats.decode(text + " " * (MAX_LENGTH + 1 - len(text)))


def test_a_report_of_exactly_the_limit_is_written_and_read() -> None:
    room = MAX_LENGTH - len(beats.encode(cloud_beat(body=report(input_ages_us=(1000,)))))
    last = 11_000 if room % 2 else 1000
    beat = cloud_beat(body=report(input_ages_us=(1000,) * (room // 2) + (last,)))
    text = beats.encode(beat)
    assert len(text) == MAX_LENGTH
    assert beats.decode(text) == beat


def test_a_report_over_the_limit_is_not_sent_and_says_what_to_change() -> None:
    with pytest.raises(BeatError, match="declare fewer rated inputs"):
        beats.encode(cloud_beat(body=report(input_ages_us=(123_456,) * 300)))


def test_what_cannot_be_written_is_sent_as_a_bare_beat_so_that_the_sender_lives_on() -> None:
    bare = beats.decode(beats.encode_fitting(cloud_beat(body=report(input_ages_us=(123_456,) * 300))))
    assert bare == cloud_beat(body=None)
    assert beats.encode_fitting(cloud_beat()) == beats.encode(cloud_beat())


def test_sixty_four_inputs_whose_robot_was_away_for_a_week_fit() -> None:
    week_us = 7 * 86_400 * 10**6
    beat = beats.decode(beats.encode(cloud_beat(body=report(data_age_us=week_us, input_ages_us=(week_us,) * 64))))
    assert isinstance(beat.body, CloudReport)
    assert set(beat.body.input_ages_us) == {MAX_AGE_MS * 1000}, "older than any limit"


@pytest.mark.parametrize(("age_us", "read_us"), [(0, 0), (1, 1000), (1000, 1000), (1001, 2000), (-1, -1)])
def test_an_age_is_never_read_as_younger_than_it_was(age_us: int, read_us: int) -> None:
    beat = beats.decode(beats.encode(cloud_beat(body=report(data_age_us=age_us))))
    assert isinstance(beat.body, CloudReport)
    assert beat.body.data_age_us == read_us


@pytest.mark.parametrize(
    ("place", "word"),
    [
        (1, ""), (1, "a/b"), (1, "\u00fc"), (1, "x" * 64),  # uid
        (2, "R"), (2, "x"),  # side
        (3, "a" * 31), (3, "A" * 32), (3, "g" * 32),  # incarnation
        (4, "-1"), (4, "1.0"), (4, "+1"), (4, "1_0"), (4, "\u0663"), (4, "\u00b2"), (4, ""),
        (4, str(MAX_INTEGER)), (4, "9" * 400),
        (5, "-1"), (6, str(-MAX_INTEGER - 1)), (7, "-2"),
        (8, "c" * 33), (9, "-1"), (10, "-1"), (11, "-1"),  # echo
        (12, "zz"), (13, "-1"), (14, "yes"), (17, "-2"), (18, "1,,2"), (18, "1,-2"), (18, ","),  # report
    ],
)  # fmt: skip
def test_a_word_that_does_not_belong_there_is_refused(place: int, word: str) -> None:
    words = beats.encode(cloud_beat()).split(" ")
    words[place] = word
    with pytest.raises(BeatError, match="BadForm"):
        beats.decode(" ".join(words))


@pytest.mark.parametrize("beat", [cloud_beat(), robot_beat()], ids=["cloud", "robot"])
def test_words_after_the_end_are_refused(beat: Beat) -> None:
    with pytest.raises(BeatError, match="too long"):
        beats.decode(beats.encode(beat) + " 0")


@pytest.mark.parametrize("beat", [cloud_beat(echo=None, body=None), robot_beat(echo=None, body=None)], ids=["c", "r"])
@pytest.mark.parametrize("word", ["0", "-\0", "x", ""])
def test_an_echo_of_nobody_says_nothing(beat: Beat, word: str) -> None:
    with pytest.raises(BeatError, match="BadForm"):
        beats.decode(beats.encode(beat)[:-1] + word)


def test_the_part_of_one_side_is_not_read_as_the_others() -> None:
    words = beats.encode(cloud_beat()).split(" ")
    words[2] = "r"
    with pytest.raises(BeatError):
        beats.decode(" ".join(words))


def test_a_grant_names_the_whole_token() -> None:
    token = Permission(7, True, CLOUD, 250_000).token(ROBOT)
    assert (token.robot, token.epoch, token.cloud) == (ROBOT, 7, CLOUD)
