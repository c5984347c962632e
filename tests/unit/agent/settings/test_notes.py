"""The notes of the two control processes: what is written is read back, and nothing else is taken for notes."""

from __future__ import annotations

import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot_offload_agent.settings.notes import (
    MAX_GENERATION,
    MAX_MESSAGE,
    MAX_NAME,
    CloudNotes,
    NotesError,
    RobotNotes,
    decode_cloud,
    decode_robot,
    encode,
)
from robot_offload_agent.settings.offer import MAX_AUTHOR, Offer
from robot_offload_core.control.nodes.replica_parameters import MAX_NODES, Statement

values = st.text() | st.booleans() | st.integers(-(2**53), 2**53) | st.lists(st.text())
authors = st.text(st.characters(min_codepoint=32, max_codepoint=126), max_size=MAX_AUTHOR)
offers = st.builds(Offer, st.integers(0, 2**53), st.dictionaries(st.text(), values), authors)
reasons = st.text("CamelCase", max_size=40)
names = st.text(max_size=MAX_NAME)
digests = st.text("0123456789abcdef", max_size=16)
statements = st.builds(Statement, digests, digests, st.none() | st.dictionaries(names, digests, max_size=5))
parameters = st.dictionaries(names, statements, max_size=5)
vetoes = st.lists(st.tuples(reasons, st.text(max_size=80)), max_size=3).map(tuple)
robots = st.builds(
    RobotNotes, st.integers(0, MAX_GENERATION), names, st.booleans(), reasons, st.text(), names,
    st.sampled_from(["robot", "cloud"]), reasons, st.text(), parameters=parameters, dials=st.text(),
)  # fmt: skip


@settings(deadline=None)
@given(
    st.builds(
        CloudNotes, st.none() | offers, names, vetoes=vetoes, parameters=parameters,
        release=st.sampled_from(["", "0.1.0", "1!2.0rc1.dev4+local"]),
    )
)  # fmt: skip
def test_the_clouds_notes_are_read_back(notes: CloudNotes) -> None:
    read = decode_cloud(encode(notes))
    assert read == notes
    assert (read.offer and read.offer.digest) == (notes.offer and notes.offer.digest)


@settings(deadline=None)
@given(robots)
def test_the_robots_notes_are_read_back(notes: RobotNotes) -> None:
    assert decode_robot(encode(notes)) == notes


def test_texts_for_people_are_bounded_before_they_reach_the_operator() -> None:
    notes = RobotNotes(message="x" * 5000, decided_message="y" * 5000, dials="z" * 5000)
    read = decode_robot(encode(notes))
    assert {len(text) for text in (read.message, read.decided_message, read.dials)} == {MAX_MESSAGE}


@pytest.mark.parametrize(
    "notes",
    [
        RobotNotes(-1),
        RobotNotes(10**30),
        RobotNotes(reason="<b>"),
        RobotNotes(decided="x y"),
        RobotNotes(left="x" * 999),
    ],
)
def test_values_that_no_robot_of_ours_would_say_are_refused(notes: RobotNotes) -> None:
    with pytest.raises(NotesError):
        decode_robot(encode(notes))


@pytest.mark.parametrize(
    "parameters",
    [
        [], {"walker": 1}, {"walker": ["", ""]}, {"walker": ["xyz", "", None]}, {"walker": ["", "", {"speed": 1}]},
        {f"node{n}": ["", "", None] for n in range(MAX_NODES + 1)}, {"x" * 999: ["", "", None]},
    ],
)  # fmt: skip
def test_parameters_of_another_form_are_refused_from_either_side(parameters: object) -> None:
    for plain, decode in ((RobotNotes(), decode_robot), (CloudNotes(), decode_cloud)):
        with pytest.raises(NotesError):
            decode(json.dumps({**json.loads(encode(plain)), "parameters": parameters}))


@pytest.mark.parametrize("vetoes", [{}, [1], [["a"]], [["a", 1]], [["a", "b"]] * 99])
def test_vetoes_of_another_form_are_refused(vetoes: object) -> None:
    with pytest.raises(NotesError):
        decode_cloud(json.dumps({**json.loads(encode(CloudNotes())), "vetoes": vetoes}))


def test_what_a_newer_robot_says_besides_is_left_out() -> None:
    body = {**json.loads(encode(RobotNotes(3))), "news": 1}
    assert decode_robot(json.dumps(body)) == RobotNotes(3)


@pytest.mark.parametrize(
    "text",
    ["", "{", "[]", "{}", '{"leaving": 1}', '{"leaving": "", "offer": [1]}', '{"leaving": "", "offer": [true, {}]}'],
)
def test_what_is_none_of_the_clouds_notes_is_refused(text: str) -> None:
    with pytest.raises(NotesError):
        decode_cloud(text)


@pytest.mark.parametrize(
    "text", ["", "[]", '{"generation": "1"}', '{"accepted": 1}', '{"site": "moon"}', '{"left": null}']
)
def test_what_is_none_of_the_robots_notes_is_refused(text: str) -> None:
    with pytest.raises(NotesError):
        decode_robot(text)


@settings(deadline=None)
@given(
    st.text()
    | st.recursive(
        st.none() | st.integers() | st.text(),
        lambda c: (
            st.lists(c) | st.dictionaries(st.sampled_from(["leaving", "offer", "site", "parameters", "vetoes"]), c)
        ),
    ).map(json.dumps)
)
def test_no_text_whatever_does_any_harm(text: str) -> None:
    for decode in (decode_cloud, decode_robot):
        try:
            decode(text)
        except NotesError:
            continue


@pytest.mark.parametrize("release", [7, None, "1.0\nnext", "x" * 65, ["0.1.0"]])
def test_a_release_of_another_form_is_not_shown_and_costs_nothing_else(release: object) -> None:
    body = {**json.loads(encode(CloudNotes(leaving="end"))), "release": release}
    assert decode_cloud(json.dumps(body)) == CloudNotes(leaving="end")


@pytest.mark.parametrize("author", [None, 7, ["x"], "two\nlines", "\x1b[31m", "é"])
def test_an_author_of_another_form_is_nobody_and_costs_nothing_else(author: object) -> None:
    body = json.loads(encode(CloudNotes(Offer(7, {"pin": "Robot"}, "kubectl-edit at noon"))))
    assert decode_cloud(json.dumps({**body, "author": author})).offer == Offer(7, {"pin": "Robot"})
    del body["author"]  # of a cloud that is older
    assert decode_cloud(json.dumps(body)).offer == Offer(7, {"pin": "Robot"})
