"""The chain of an audit trail: what was altered is seen."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_offload_core.record.audit import (
    BEGINNING,
    MAX_TEXT,
    Head,
    Kind,
    exported,
    line,
    parse,
    parse_head,
    sentences,
    verify,
)


def trail(count: int) -> list[str]:
    head, lines = Head(), []
    for number in range(count):
        head, text = line(head, f"2026-11-23T00:00:{number:02d}Z", Kind.PIN, "somebody", {"to": f"{number}"})
        lines.append(text)
    return lines


def heads(lines: list[str]) -> list[Head]:
    return [entry.head for text in lines if (entry := parse(text)) is not None]


def test_a_trail_is_one_chain_from_its_beginning() -> None:
    lines = trail(20)
    verdict = verify(lines, heads(lines)[7])
    assert (verdict.problems, verdict.entries, verdict.first, verdict.last.number) == ((), 20, 1, 20)
    first = parse(lines[0])
    assert first is not None
    assert first.previous == BEGINNING


def test_an_empty_trail_is_in_order_unless_something_was_seen() -> None:
    assert verify([]).problems == ()
    assert verify([], Head(3, "a" * 64)).problems != ()


@given(st.integers(0, 9), st.integers(0, 400), st.sampled_from('0a"{ z'))
def test_every_edited_character_is_seen(position: int, at: int, put: str) -> None:
    lines = trail(10)
    text = lines[position].rstrip("\n")
    at = min(at, len(text) - 1)
    edited = text[:at] + put + text[at + 1 :]
    if edited != text:
        lines[position] = edited + "\n"
        assert verify(lines).problems


@given(st.permutations(range(6)))
def test_every_other_order_is_seen(order: list[int]) -> None:
    lines = trail(6)
    problems = verify([lines[each] for each in order]).problems
    assert bool(problems) is (list(order) != sorted(order))


@pytest.mark.parametrize("gone", range(1, 9))
def test_a_line_that_was_taken_out_is_seen(gone: int) -> None:
    lines = trail(10)
    del lines[gone]
    assert verify(lines).problems


def test_what_was_cut_off_at_the_end_is_seen_by_who_kept_a_head() -> None:
    lines = trail(10)
    kept = heads(lines)[8]
    assert verify(lines[:7]).problems == ()
    [problem] = verify(lines[:7], kept).problems
    assert "was cut" in problem


def test_a_trail_that_was_written_anew_is_seen_by_who_kept_a_head() -> None:
    kept = heads(trail(5))[4]
    head, lines = Head(), []
    for number in range(9):
        head, text = line(head, "2026-11-23T00:00:00Z", Kind.PIN, "thief", {"to": f"{number}"})
        lines.append(text)
    assert verify(lines).problems == ()
    [problem] = verify(lines, kept).problems
    assert "written anew" in problem


def test_a_trail_whose_oldest_file_has_gone_begins_later() -> None:
    lines = trail(10)
    verdict = verify(lines[4:])
    assert (verdict.problems, verdict.first) == ((), 5)
    [problem] = verify(lines[4:], heads(lines)[1]).problems
    assert "gone with the oldest file" in problem


def test_a_torn_end_is_no_alteration() -> None:
    lines = trail(3)
    verdict = verify([*lines[:2], lines[2][:40]])
    assert (verdict.problems, verdict.torn, verdict.entries) == ((), True, 2)


def test_a_torn_line_that_the_next_entry_names_is_no_alteration() -> None:
    lines = trail(3)
    _, text = line(heads(lines)[1], "2026-11-23T00:00:09Z", Kind.TORN, "agent", {})
    assert verify([*lines[:2], lines[2][:40] + "\n", text]).problems == ()


@pytest.mark.parametrize("text", ["", "{}", "[]", "[1,2]", "null", "x" * 100, "[" * 5000, '[0,1,"","","",{},"",""]'])
def test_garbage_is_no_entry_and_is_named(text: str) -> None:
    assert parse(text) is None
    lines = trail(2)
    assert verify([lines[0], text + "\n", lines[1]]).problems


def test_texts_of_others_are_bounded() -> None:
    _, text = line(Head(), "2026-11-23T00:00:00Z", Kind.SETTINGS, "w" * 9999, {"message": "m" * 9999})
    entry = parse(text)
    assert entry is not None
    assert (len(entry.who), len(entry.what["message"])) == (MAX_TEXT, MAX_TEXT)


def test_a_head_is_read_as_it_is_printed() -> None:
    head = heads(trail(3))[2]
    assert parse_head(str(head)) == head
    assert [parse_head(text) for text in ("", "3", "3:xyz", f"-3:{'a' * 64}", f"³:{'a' * 64}")] == [None] * 5


def test_the_export_is_plain_json() -> None:
    entries = json.loads(json.dumps(exported([*trail(2), "garbage\n"])))
    assert [entry["what"] for entry in entries] == [{"to": "0"}, {"to": "1"}]


def test_lines_of_another_version_are_named_as_such_and_not_as_altered() -> None:
    lines = trail(6)
    newer = [json.dumps([2, number, {"any": "thing"}]) + "\n" for number in (4, 5)]
    mixed = [*lines[:3], *newer, *lines[3:]]
    verdict = verify(mixed, heads(lines)[4])
    assert (verdict.problems, verdict.entries, verdict.others, verdict.other) == ((), 6, 2, 2)
    said = " ".join(sentences(verdict))
    assert "NOT CHECKED: 2 lines were written by another version of the agent (format 2, this one reads 1)" in said
    assert "NOT AS WRITTEN" not in said
    assert "nothing was altered" not in said
    assert verify(newer).entries == 0
    assert "No line was checked" in " ".join(sentences(verify(newer)))


def test_a_line_that_is_made_to_look_like_another_versions_does_not_hide_what_it_replaced() -> None:
    lines = trail(6)
    forged = [*lines[:2], lines[2].replace("[1,", "[2,", 1), *lines[3:]]
    verdict = verify(forged)
    assert verdict.others == 1
    assert verdict.problems == ("line 4: entry 4 does not follow entry 2",)
