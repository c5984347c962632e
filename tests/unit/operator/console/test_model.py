"""The console's memory: what comes from a source, and what the pages show of it."""

from __future__ import annotations

import datetime
import json
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_offload.console import tables
from robot_offload.console.figures import strips
from robot_offload.console.live import Changeover, Errand, Key, Live, NodeState, TopicFlow
from robot_offload.console.model import Declared, Fleet, Gone, Said, Switched, Track, Trouble
from robot_offload.console.reading import EventError, bounds, of_event, of_state
from robot_offload.console.rows import row
from tests.unit.operator.reporter.states import REPORT
from tests.unit.operator.reporter.states import text as state_text

KEY = Key("ward", "wheelchair-7")
NOW = datetime.datetime(2026, 11, 23, 12, 0, tzinfo=datetime.UTC)
NOW_S = NOW.timestamp()
CLOUD = Live(site="cloud", reason="LinkGood", message="good", connected=True, latency_ms=12.0)
ROBOT = Live(site="robot", reason="HeartbeatLost", message="lost", connected=True, cut=True)


def manifest(**status: Any) -> dict[str, Any]:
    return {
        "metadata": {"name": "wheelchair-7", "namespace": "ward", "uid": "1", "generation": 3},
        "spec": {"switching": {"latency": {"robotPeriod": "50ms", "cloudPeriod": "20ms", "tolerance": "30ms"}}},
        "status": {"placement": "Cloud", "placementReason": "LinkGood", "placementMessage": "good", **status},
    }


def fleet(*events: Any) -> Fleet:
    found = Fleet("test")
    for event in events:
        found.take(event)
    return found


def shown(found: Fleet) -> dict[str, Any]:
    return row(found.tracks[KEY], NOW_S, NOW)


def test_a_resource_without_live_numbers_shows_what_its_status_says_and_why_there_are_none() -> None:
    found = shown(fleet(Declared(KEY, manifest()), Trouble(KEY, "the cloud agent has no ready pod")))
    assert found["placement"] == "☁ Cloud"
    assert found["reason"] == "LinkGood: good"
    assert (found["quality"], found["trouble"]) == ("no live numbers", "the cloud agent has no ready pod")


def test_a_change_of_side_is_a_changeover_and_its_silence_is_added_when_it_is_known() -> None:
    switched = Changeover(NOW_S - 5.0, "robot", "HeartbeatLost", gap_ms=140.0)
    found = fleet(Said(KEY, NOW_S - 6, CLOUD), Said(KEY, NOW_S - 4.9, ROBOT), Said(KEY, NOW_S, ROBOT))
    assert [change.to for change in found.tracks[KEY].changeovers] == ["robot"]
    both = fleet(Said(KEY, NOW_S - 6, CLOUD), Switched(KEY, switched), Said(KEY, NOW_S - 4.9, ROBOT))
    assert list(both.tracks[KEY].changeovers) == [switched]
    assert shown(both)["gap"] == "140 ms"
    assert shown(both)["since"] == "5s"


def test_an_unknown_side_in_between_is_no_changeover() -> None:
    words = (CLOUD, Live(), CLOUD)
    found = fleet(*(Said(KEY, NOW_S + second, word) for second, word in enumerate(words)))
    assert not found.tracks[KEY].changeovers


def test_a_word_that_comes_late_does_not_take_the_newer_one_back() -> None:
    found = fleet(Said(KEY, NOW_S, ROBOT), Said(KEY, NOW_S - 1, CLOUD))
    assert found.tracks[KEY].live == ROBOT


def test_numbers_that_stopped_coming_are_not_shown_as_present() -> None:
    assert shown(fleet(Said(KEY, NOW_S - 60, CLOUD)))["quality"] == "silent"
    assert shown(fleet(Said(KEY, NOW_S, CLOUD)))["quality"] == "● 12 ms"
    assert shown(fleet(Said(KEY, NOW_S, ROBOT)))["quality"] == "✕ cut"


def test_the_small_picture_of_the_link_holds_line_cuts_and_bound() -> None:
    found = shown(fleet(Declared(KEY, manifest()), Said(KEY, NOW_S - 60, CLOUD), Said(KEY, NOW_S - 1, ROBOT)))
    assert found["sparkLine"].startswith("60,")
    assert found["sparkCuts"] == "M118,0V24"
    assert found["sparkBound"] == 8.0


def test_a_deleted_resource_is_gone_and_the_source_can_be_in_trouble_as_a_whole() -> None:
    found = fleet(Declared(KEY, manifest()), Gone(KEY), Trouble(None, "the API server does not answer"))
    assert (found.sorted(), found.problem) == ([], "the API server does not answer")


def test_scrolled_back_the_tables_are_those_of_that_moment() -> None:
    topics = [Live(site="cloud", topics=(TopicFlow("/scan", 10 * n, 1000 * n, 3.0),)) for n in range(6)]
    track = fleet(*(Said(KEY, NOW_S + n, live) for n, live in enumerate(topics))).tracks[KEY]
    assert track.at(NOW_S + 2.5) == topics[2]
    [shown_row] = tables.topics(track, track.at(NOW_S + 5), NOW_S + 5)
    assert (shown_row["rate"], shown_row["bandwidth"], shown_row["age"]) == ("10.0 Hz", "1.0 kB/s", "3 ms")


def test_the_strip_has_a_band_for_each_stay_and_a_gap_where_the_link_was_cut() -> None:
    track = fleet(
        Declared(KEY, manifest()), *(Said(KEY, NOW_S + n, CLOUD if n < 3 else ROBOT) for n in range(6))
    ).tracks[KEY]
    options = strips(track, NOW_S + 5, run=False)
    latency = options["series"][0]
    assert [value for _, value in latency["data"]] == [12.0, 12.0, 12.0, None, None, None]
    assert [start["name"] for start, _ in latency["markArea"]["data"]] == ["cloud acts", "robot acts"]
    assert latency["markLine"]["data"][0]["yAxis"] == 60.0
    json.dumps(options)


def test_the_rules_numbers_are_those_of_the_specification_and_its_defaults() -> None:
    assert bounds({}).allowed_ms == 60.0
    assert bounds({"switching": {"profile": "Responsive", "aNewerField": 1}}).loss_timeout_ms == 45.0
    assert bounds({"switching": {"latency": {"tolerance": "unreadable"}}}).allowed_ms is None


def event(**state: Any) -> str:
    return json.dumps({"at": NOW_S, "state": {"version": 1, "site": "cloud", **state}, "robot": {"cpu": 0.25}})


def test_an_event_of_the_stream_becomes_a_word() -> None:
    link = {"latency_ms": 14.5, "loss_share": 0.02}
    at_s, live = of_event(event(link=link, nodes=[{"name": "c", "state": "active"}], connected=True))
    assert (at_s, live.latency_ms, live.loss_share, live.cut) == (NOW_S, 14.5, 0.02, False)
    assert live.numbers == (("cpu", "0.25"),)
    assert of_event(event(round_trip_ms={"p50": 9.0}))[1].latency_ms == 9.0  # of an agent that is older


def test_the_robots_own_report_fills_the_tables() -> None:
    report = {
        "release": "0.1.0",
        "nodes": {"controller": "active"},
        "topics": {"/scan": [100, 5, 0, 2]},
        "goals": {"/drive": [3, 1, 0]},
        "states": {"localiser": 120},
        "processes": {"control": [1500, 30_720, 0]},
        "beats": [1000, 3],
    }
    state = {"version": 1, "site": "robot", "carried": [{"topic": "/scan", "bytes": 5000}]}
    _, live = of_event(json.dumps({"at": NOW_S, "state": state, "robot": report}))
    assert [(node.name, node.side, node.state) for node in live.nodes] == [("controller", "robot", "active")]
    assert live.topics == (TopicFlow("/scan", 100, 5000, left_out="5 over the rate, 2 unsent"),)
    assert live.goals[0].state == "ended"  # of an agent that is older
    assert live.goals[0].detail == "3 succeeded, 1 aborted, 0 canceled"
    assert live.state_ages_ms == (("localiser on the robot", 120.0),)
    assert dict(live.numbers) == {
        "release": "0.1.0", "process control": "1.5 s of a core, 30 MiB, 0 deaths", "beats": "1000, 3",
    }  # fmt: skip


@pytest.mark.parametrize(
    "report", [{"nodes": [1], "topics": 5, "goals": {"/a": "x"}, "processes": {"c": [True]}}, [], 7]
)
def test_a_robots_report_of_any_form_breaks_nothing(report: Any) -> None:
    assert of_event(json.dumps({"at": NOW_S, "state": {"version": 1}, "robot": report}))[1].site == "unknown"


@pytest.mark.parametrize(
    "data",
    ["", "{", "[]",
     '{"at": "x", "state": {}}', '{"at": 1, "state": null, "problem": "silent"}', '{"at": 1, "state": 5}',
     event(version=2), event(epoch="many"), event(link=[1], site=7), '{"at":1,"state":' + "[" * 100_000],
)  # fmt: skip
def test_garbage_in_the_stream_is_told_and_never_raised_further(data: str) -> None:
    with pytest.raises(EventError):
        of_event(data)


def test_a_track_that_knows_nothing_can_be_shown() -> None:
    track = Track(KEY)
    assert row(track, NOW_S, NOW)["quality"] == "no live numbers yet"
    assert tables.nodes(track, track.live) == tables.topics(track, track.live, NOW_S) == []
    assert strips(track, NOW_S, run=True)["series"][0]["data"] == []


def test_the_robots_report_names_its_nodes_and_what_it_left_out() -> None:
    state = json.loads(state_text())
    live = of_state(state, REPORT)
    assert NodeState("controller", "robot", "active") in live.nodes
    scan, command = live.topics
    assert (scan.topic, scan.messages, scan.age_ms, scan.left_out) == ("/scan", 100, 9, "4 thinned, 1 unsent")
    assert (command.topic, command.age_ms) == ("/cmd_vel", 14)
    assert live.goals == (
        Errand("goals of /go", "1 executing, 2 waiting, 4 restarts", "3 succeeded, 0 aborted, 1 canceled"),
    )
    assert live.services == (
        Errand("calls of /plan", "3 open"), Errand("at servers outside", "1 goals, 0 calls open")
    )  # fmt: skip


def test_the_silence_of_the_last_switch_comes_from_the_robots_report_also_when_nobody_looked_then() -> None:
    said = of_state(json.loads(state_text()), REPORT)
    found = fleet(Declared(KEY, manifest()), Said(KEY, NOW_S, said))
    assert list(found.tracks[KEY].changeovers) == [Changeover(NOW_S - 40.0, "cloud", "LinkGood", gap_ms=61.5)]
    assert (shown(found)["gap"], shown(found)["since"]) == ("62 ms", "40s")
    found.take(Said(KEY, NOW_S + 1, replace(said, site="robot")))  # seen before it is told of
    assert [change.gap_ms for change in found.tracks[KEY].changeovers] == [61.5, None]
    told = Changeover(-2.0, "robot", "HeartbeatLost", gap_ms=140.0)
    found.take(Said(KEY, NOW_S + 2, replace(said, site="robot", last=told)))
    assert [change.gap_ms for change in found.tracks[KEY].changeovers] == [61.5, 140.0]
    missed = replace(told, gap_ms=90.0)
    found.take(Said(KEY, NOW_S + 60, replace(said, site="robot", last=missed)))
    assert [change.gap_ms for change in found.tracks[KEY].changeovers] == [61.5, 140.0, 90.0]


@given(
    st.dictionaries(
        st.sampled_from(["changeover", "ages", "actions", "services", "used", "goals"]),
        st.recursive(
            st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
            lambda inner: (
                st.lists(inner, max_size=4)
                | st.dictionaries(st.sampled_from(["to", "ago_s", "gap_ms", "reason", "robot", "/go"]), inner)
            ),
            max_leaves=8,
        ),
    )
)
def test_a_report_of_any_form_is_shown_as_far_as_it_goes(report: dict[str, Any]) -> None:
    found = fleet(Declared(KEY, manifest()), Said(KEY, NOW_S, of_state(json.loads(state_text()), report)))
    track = found.tracks[KEY]
    assert shown(found)["name"] == KEY.name
    tables.topics(track, track.live, NOW_S)
    tables.handed(track.live)
    tables.changeovers(track, run=False)
