"""Reading the agent's state without trust, and how old it is."""

from __future__ import annotations

import json

import pytest

from robot_offload.api.agent_state import (
    FRESH_S,
    MAX_SENTENCE,
    MAX_TEXT,
    UNREADABLE,
    AgentState,
    Carried,
    Settings,
    Sight,
    StateError,
    lasting,
    look,
    parse_state,
)
from tests.unit.operator.reporter.states import SINCE, seen, text


def test_a_state_is_read_whole() -> None:
    assert parse_state(text(handover="ab")) == AgentState(
        agent_generation=3,
        connected=True,
        since=SINCE,
        site="cloud",
        epoch=12,
        reason="LinkGood",
        message="the link sustains the cloud",
        round_trip_p50_ms=11.5,
        round_trip_p99_ms=19.0,
        carried=(Carried("/scan", "to_cloud", 123456, 400, 9),),
        state_ages_ms=(("controller_1", 85),),
        nodes=(("controller", "active"),),
        settings=Settings(3, True, "Accepted", "in use"),
        ready=True,
        handover="ab",
        written="2026-11-21T10:05:00Z",
    )


def test_a_newer_agent_may_say_more_and_a_young_one_less() -> None:
    assert parse_state(text(weather="fine")) == parse_state(text())
    assert parse_state('{"version": 1}') == AgentState()
    assert parse_state(text(round_trip_ms={"p50": None, "p99": None})).round_trip_p50_ms is None


@pytest.mark.parametrize(
    "broken",
    [
        "",
        "{",
        "[]",
        "null",
        text(version=2),
        text(connected="yes"),
        text(epoch=True),
        text(epoch="12"),
        text(nodes=["controller"]),
        text(nodes={"controller": "active"}),
        text(round_trip_ms=12),
        text(round_trip_ms={"p50": "12"}),
        text(settings=[1]),
    ],
)
def test_what_is_no_state_is_refused_with_a_sentence(broken: str) -> None:
    with pytest.raises(StateError, match="the agent's state"):
        parse_state(broken)


@pytest.mark.parametrize("reason", ["a" * 65, "two words", "x" * 400, "Ünclear", "Line\nBreak", "<b>"])
def test_a_reason_that_is_no_single_word_is_not_passed_on(reason: str) -> None:
    state = parse_state(text(reason=reason, settings={"reason": reason}))
    assert (state.reason, state.settings.reason) == (UNREADABLE, UNREADABLE)


@pytest.mark.parametrize(
    ("said", "shown"),
    [
        ("all \x1b[31mred\x1b[0m", "all red"),
        ("a \x1b]0;title\x07b", "a b"),
        ("one\r\ntwo\ttab\x9b31m", "one  two tab 31m"),
        ("abc\u202ecba\u2066", "abc cba "),
        ("fährt \N{ROBOT FACE}", "fährt \N{ROBOT FACE}"),
    ],
)
def test_what_the_robot_says_cannot_move_the_cursor_of_who_reads_it(said: str, shown: str) -> None:
    told = {**json.loads(text()), "message": said, "nodes": [{"name": said, "state": "active"}]}
    state = parse_state(json.dumps(told))
    assert state.message == shown
    assert state.nodes == ((shown, "active"),)


def test_sentences_of_the_robot_are_cut() -> None:
    state = parse_state(text(message="m" * 5000, settings={"message": "n" * 5000}))
    assert (len(state.message), len(state.settings.message)) == (MAX_SENTENCE, MAX_SENTENCE)


@pytest.mark.parametrize(
    "flood",
    [
        text(settings={"robot_generation": 10**30}),
        text(epoch=-(10**30)),
        text(round_trip_ms={"p50": 10**400}),
        text(nodes=[{"name": "n", "state": "active"}] * 65),
        text(message="m" * MAX_TEXT),
        "[" * 10_000,
    ],
)
def test_what_is_too_large_is_refused_with_a_short_sentence(flood: str) -> None:
    with pytest.raises(StateError, match="the agent's state") as refused:
        parse_state(flood)
    assert len(str(refused.value)) < 200


def test_a_number_that_is_none_is_left_out() -> None:
    assert parse_state(text(round_trip_ms={"p50": float("nan")})).round_trip_p50_ms is None


def test_live_numbers_are_left_out_of_what_lasts() -> None:
    early, late = text(), text(written="2026-11-21T11:11:11Z", round_trip_ms={"p50": 80.0, "p99": 99.0})
    assert lasting(early) == lasting(late)
    assert lasting(early) != lasting(text(epoch=13))
    assert "round_trip_ms" not in json.loads(lasting(early))
    assert ", " not in lasting(early)  # compact


def test_a_state_is_fresh_while_its_content_changes() -> None:
    first = seen(100.0)
    same = look(first, text(), 104.0)
    assert same.fresh(100.0 + FRESH_S)
    assert not same.fresh(100.1 + FRESH_S)
    changed = look(same, text(written="2026-11-21T10:05:01Z"), 104.0)
    assert changed.fresh(104.0 + FRESH_S)


def test_a_file_left_by_a_dead_agent_is_old_at_the_first_look() -> None:
    sight = look(Sight(), text(), 100.0, written_ago_s=60.0)
    assert not sight.fresh(100.0)
    assert sight.state is not None


def test_a_clock_that_was_set_back_makes_no_state_younger_than_now() -> None:
    assert look(Sight(), text(), 100.0, written_ago_s=-3600.0).age_s(100.0) == 0.0


def test_no_file_and_half_a_file_keep_the_last_state_until_it_is_old() -> None:
    for trouble in (None, text()[:40]):
        sight = look(seen(100.0), trouble, 101.0)
        assert sight.problem
        assert sight.fresh(101.0)
        assert not sight.fresh(106.0)


def test_a_file_that_comes_back_unchanged_is_no_sign_of_life() -> None:
    gone = look(seen(100.0), None, 103.0)
    back = look(gone, text(), 110.0)
    assert (back.problem, back.fresh(110.0)) == ("", False)


def test_before_the_first_file_nothing_is_known() -> None:
    assert (Sight().state, Sight().fresh(0.0)) == (None, False)
    assert "not started" in look(Sight(), None, 0.0).problem
