"""Goals, calls and state in a run: what the report has of them, and which promises are judged."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from typing import Any

import pytest

from robot_offload_lab.judge import accounts, handed
from robot_offload_lab.judge.invariants import violations
from robot_offload_lab.judge.measures import measure
from robot_offload_lab.judge.recording import (
    LINES,
    Calls,
    Errand,
    PathPoint,
    PlacementChange,
    Record,
    Restored,
    RunInfo,
    assemble,
)
from robot_offload_lab.judge.report import build, html
from robot_offload_lab.show.summary import summary
from tests.unit.lab.judge.recordings import RUN, START_S, calm_run, inhibited
from tests.unit.lab.judge.test_report import Page


def errand(t_s: float, **changes: Any) -> Errand:
    known = Errand(START_S + t_s, 1, "", 4.5, round(t_s * 50), 1, 0, 20.0, 0, 1.0, 0.0)
    return dataclasses.replace(known, **changes)


def handed_on() -> list[Record]:
    """The calm run with a goal on its way through its three switches, calls, and state that is taken at each switch."""
    takings = [(2.05, "cloud", 0.12), (10.1, "robot", 0.2), (15.05, "cloud", 0.1)]
    nodes = {"robot": "localiser", "cloud": "remote_localiser"}
    return [
        *calm_run(),
        *(errand(n / 10, x_m=1.0 + n * 0.08, servers=1 + (n >= 100) + (n >= 150)) for n in range(10, 190)),
        errand(19.0, servers=3, ending="succeeded", results=1),
        Calls(START_S + 19.0, 36, 36, 0, 0, 210.0),
        Restored(START_S + 0.1, "localiser", "robot", None),
        *(Restored(START_S + t_s, nodes[site], site, age_s) for t_s, site, age_s in takings),  # type: ignore[arg-type]
    ]


def kinds(records: Sequence[Record]) -> list[str]:
    return [violation.kind for violation in violations(measure(assemble(records)))]


def test_a_goal_its_calls_and_the_state_stand_in_the_report() -> None:
    report = build(measure(assemble(handed_on())))
    assert report["violations"] == []
    assert report["goals"] == [
        {
            "goal": 1, "ending": "succeeded", "t_s": 19.0, "results": 1, "accepted_ms": 4.5, "restarts": 2,
            "feedback": 950, "backwards": 0, "silence_ms": 20.0, "error_m": pytest.approx(0.2, abs=0.2),
        }
    ]  # fmt: skip
    assert report["calls"] == {"asked": 36, "answered": 36, "failed": 0, "unanswered": 0, "longest_ms": 210.0}
    assert [(taking["node"], taking["age_ms"]) for taking in report["state"]] == [
        ("remote_localiser", 120.0),
        ("localiser", 200.0),
        ("remote_localiser", 100.0),
    ]


def test_a_person_reads_of_goals_calls_and_state(tmp_path: Any) -> None:
    measures = measure(assemble(handed_on()))
    report = build(measures)
    lines = "\n".join(summary(report, tmp_path))
    assert "goal 1: succeeded, 1 result, 950 feedback messages from 3 turns, longest silence 20 ms" in lines
    assert "state taken over: 3 of 3 times, at most 200 ms old" in lines
    assert "calls: 36, answered 36, failed 0, the longest wait 210 ms" in lines
    page = Page(html(report, measures))
    assert page.open == []
    assert "result of goal 1 (succeeded), 2 restarts" in page.text


@pytest.mark.parametrize(
    ("changes", "kind"),
    [
        ({"results": 2}, "GoalTwice"),
        ({"ending": "aborted"}, "GoalLost"),
        ({"ending": "rejected"}, "GoalLost"),
        ({"backwards": 3}, "GoalBackwards"),
        ({"silence_ms": 900.0}, "GoalGap"),
    ],
)
def test_a_broken_promise_about_a_goal_is_named(changes: dict[str, Any], kind: str) -> None:
    records = [dataclasses.replace(it, **changes) if isinstance(it, Errand) and it.ending else it for it in handed_on()]
    assert kinds(records) == [kind]


def test_silent_feedback_counts_only_while_somebody_may_steer_and_in_the_run() -> None:
    held = [*handed_on(), errand(12.0, silence_ms=900.0), *inhibited(11.2, 11.9)]
    assert kinds(held) == []
    assert kinds([*handed_on(), errand(0.5, silence_ms=900.0)]) == []


def test_a_goal_that_one_side_alone_could_not_finish_is_no_broken_promise() -> None:
    records = [
        dataclasses.replace(it, mode="cloud-only") if isinstance(it, RunInfo)
        else dataclasses.replace(it, ending="aborted") if isinstance(it, Errand) and it.ending
        else it
        for it in handed_on()
    ]  # fmt: skip
    assert kinds(records) == []


def test_a_call_without_an_answer_and_a_side_that_began_clean_are_named() -> None:
    unanswered = Calls(START_S + 19.5, 36, 35, 0, 1, 210.0)
    assert kinds([*handed_on(), unanswered]) == ["CallLost"]
    clean = [dataclasses.replace(it, age_s=None) if isinstance(it, Restored) else it for it in handed_on()]
    assert kinds(clean) == ["StateLost"] * 3


def first_taken(*said: tuple[float, float, float | None], robot_spoke: bool = True) -> tuple[list[str], Any]:
    """Judges what the cloud's node said at the first switch, at 2.0 s; heard, said, age.

    Returns:
        The kinds of the violations, and the age that the report has of that switch.
    """
    records = [it for it in handed_on() if not isinstance(it, Restored)]
    records += [Restored(START_S + 0.1, "localiser", "robot", None)] if robot_spoke else []
    records += [
        Restored(START_S + t_s, "remote_localiser", "cloud", age_s, START_S + at_s) for t_s, at_s, age_s in said
    ]
    judged = measure(assemble(records))
    return [violation.kind for violation in violations(judged)], build(judged)["state"][0]["age_ms"]


def test_what_a_node_said_before_the_switch_is_no_witness_of_what_it_began_with() -> None:
    assert first_taken((2.03, 1.93, None), (2.13, 2.13, 0.2), (2.23, 2.23, 0.2)) == ([], 200.0)


def test_a_node_that_began_clean_is_found_also_when_it_takes_the_state_a_little_later() -> None:
    for said_s in (2.0, 2.03, 2.13):
        said = (2.03, 1.93, None), (said_s + 0.01, said_s, None), (said_s + 0.11, said_s + 0.1, 0.2)
        assert first_taken(*said) == (["StateLost"], None)
    assert first_taken((2.03, 1.93, 0.2), (2.13, 2.13, None)) == (["StateLost"], None)


def test_a_stay_begins_with_its_first_message_where_the_announcement_is_late() -> None:
    moved = [dataclasses.replace(it, t_s=it.t_s + 0.2) if _first_switch(it) else it for it in handed_on()]
    clean = Restored(START_S + 2.04, "remote_localiser", "cloud", None, START_S + 2.03)
    taken = Restored(START_S + 2.14, "remote_localiser", "cloud", 0.2, START_S + 2.13)
    others = [it for it in moved if not isinstance(it, Restored) or it.t_s < START_S + 2 or it.t_s > START_S + 9]
    assert kinds([*others, clean, taken]) == ["StateLost"]


def _first_switch(record: Record) -> bool:
    return isinstance(record, PlacementChange) and START_S + 1 < record.t_s < START_S + 3


def test_a_side_that_never_said_that_it_acted_has_no_state_to_lose() -> None:
    assert first_taken((2.05, 2.05, None), robot_spoke=False) == ([], None)


@pytest.mark.parametrize(("spoke_s", "kinds_found"), [(1.5, []), (0.5, ["StateLost"])])
def test_a_change_that_waits_for_nothing_may_lose_what_was_said_just_before(
    spoke_s: float, kinds_found: list[str]
) -> None:
    records = [it for it in handed_on() if not isinstance(it, Restored)]
    records = [dataclasses.replace(it, reason="RobotUnable") if _first_switch(it) else it for it in records]  # type: ignore[arg-type]
    records += [Restored(START_S + spoke_s, "localiser", "robot", None)]
    records += [Restored(START_S + 2.1, "remote_localiser", "cloud", None, START_S + 2.1)]
    assert kinds(records) == kinds_found


def test_the_state_of_a_run_before_its_first_switch_may_be_clean() -> None:
    assert kinds([*handed_on(), Restored(START_S + 0.2, "localiser", "robot", None)]) == []


def test_a_run_without_goals_has_none() -> None:
    report = build(measure(assemble(calm_run())))
    assert (report["goals"], report["calls"], report["state"]) == ([], None, [])


def test_how_far_the_belief_is_from_the_way_is_a_figure() -> None:
    path = [PathPoint(START_S + n / 10, n * 0.08, 0.0, 0.8) for n in range(20)]
    lost = errand(1.0, x_m=0.8, y_m=2.0)
    [figures] = handed.goals(assemble([RUN, *path, lost]))
    assert figures.error_m == pytest.approx(2.0)


def test_accounts_are_read_and_garbage_is_none() -> None:
    goal = {
        "goal": 1, "accepted_ms": 5.0, "feedback": 7, "servers": 1, "backwards": 0, "silence_ms": 21.0, "results": 0,
        "ending": "", "x_m": 1.5, "y_m": None,
    }  # fmt: skip
    calls = {"asked": 2, "answered": 1, "failed": 0, "unanswered": 1, "longest_ms": 3.5}
    read = accounts.account(10.0, json.dumps({"goals": [goal], "calls": calls}))
    assert read is not None
    assert [LINES.decode(LINES.encode(record)) for record in read.records()] == list(read.records())
    assert read.goals[0].x_m == 1.5
    for text in ("", "[]", '{"goals": [3], "calls": {}}', '{"goals": [], "calls": null}'):
        assert accounts.account(10.0, text) is None


def test_a_nodes_word_of_its_state_is_read_with_the_time_at_which_it_was_said() -> None:
    def read(text: str) -> Restored | None:
        return accounts.restored(10.0, text, lambda system_s: system_s - 1000.0)

    began = read('{"node": "remote_localiser", "restored_age_s": 0.25, "at_s": 1009.5}')
    assert began == Restored(10.0, "remote_localiser", "cloud", 0.25, 9.5)
    clean = read('{"node": "localiser", "restored_age_s": null}')
    assert clean == Restored(10.0, "localiser", "robot", None)
    assert read('{"node": "localiser"}') is None
    assert read('{"node": "localiser", "restored_age_s": null, "at_s": "now"}') is None
