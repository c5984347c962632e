"""The head of the robot's audit trail in the status: what was seen last, written seldom, and said when it went back."""

from __future__ import annotations

import datetime

from hypothesis import given
from hypothesis import strategies as st

from robot_offload.decide.trail import LEAST_S, restarted, shown
from robot_offload.decide.transitions import transitions

NOW = datetime.datetime(2026, 11, 23, 12, 0, tzinfo=datetime.UTC)
OLD = {"entries": 40, "head": f"40:{'a' * 64}", "seen": "2026-11-23T11:59:30Z"}
NEW = f"41:{'b' * 64}"


def test_the_first_head_is_shown_at_once_and_what_is_not_said_stays() -> None:
    assert shown(NEW, {}, NOW) == ({"entries": 41, "head": NEW, "seen": "2026-11-23T12:00:00Z"}, None)
    assert shown("", OLD, NOW) == (OLD, None)
    assert shown(OLD["head"], OLD, NOW) == (OLD, None)


def test_a_trail_that_grows_all_the_time_is_written_once_a_minute() -> None:
    assert shown(NEW, OLD, NOW) == (OLD, 30.0)
    later, again_s = shown(NEW, OLD, NOW + datetime.timedelta(seconds=30))
    assert (later["entries"], again_s) == (41, None)


@given(st.timedeltas(datetime.timedelta(days=-400), datetime.timedelta(days=400)))
def test_no_clock_makes_the_wait_longer_than_a_minute(passed: datetime.timedelta) -> None:
    found, again_s = shown(NEW, OLD, NOW + passed)
    assert again_s is None or 0 < again_s <= LEAST_S
    assert (again_s is None) is (found["head"] == NEW)


def test_a_trail_that_was_cut_or_written_anew_is_an_event() -> None:
    assert restarted(OLD, {"entries": 41, "head": NEW}) == ""
    assert restarted({}, OLD) == restarted(OLD, OLD) == ""
    shorter = {"entries": 39, "head": f"39:{'c' * 64}"}
    (event,) = transitions({"audit": OLD}, {"audit": shorter})
    assert (event.type, event.reason) == ("Warning", "AuditTrailRestarted")
    assert "had entry 40:aaa" in event.message
    assert "39:ccc" in event.message
    assert restarted(OLD, {"entries": 40, "head": f"40:{'c' * 64}"})
