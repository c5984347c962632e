"""What is written into the robot's Lease, and when."""

from __future__ import annotations

import datetime
import itertools
import json
import re
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from robot_offload.api.agent_state import ANNOTATION, Sight, look
from robot_offload.reporter.mirror import (
    GAP_S,
    LONGEST_PAUSE_S,
    RENEW_S,
    Mirror,
    Report,
    due,
    failed,
    patch,
    report,
    succeeded,
)
from tests.unit.operator.reporter.states import SINCE, seen, text

NOW = datetime.datetime(2026, 11, 21, 10, 5, 0, tzinfo=datetime.UTC)


def told(at_s: float = 100.0, **changes: Any) -> Report:
    wanted = report(seen(at_s, **changes), at_s)
    assert wanted is not None
    return wanted


def test_a_connected_robot_holds_its_lease() -> None:
    body = patch(told(), "wheelchair-7", NOW)
    assert body["spec"] == {
        "holderIdentity": "wheelchair-7",
        "renewTime": "2026-11-21T10:05:00.000000Z",
        "acquireTime": "2026-11-21T10:00:00.000000Z",
    }
    state = json.loads(body["metadata"]["annotations"][ANNOTATION])
    assert (state["site"], state["epoch"], state["settings"]["robot_generation"]) == ("cloud", 12, 3)
    assert "round_trip_ms" not in state


def test_a_robot_that_is_gone_gives_its_lease_back_and_does_not_renew_it() -> None:
    body = patch(told(connected=False), "wheelchair-7", NOW)
    assert body["spec"] == {"holderIdentity": None}


def test_a_since_that_is_no_time_is_replaced_by_now() -> None:
    for since in ("", "yesterday", "2026-11-21T10:00:00"):
        body = patch(told(since=since), "w", NOW)
        assert body["spec"]["acquireTime"] == "2026-11-21T10:05:00.000000Z"


def test_times_are_written_as_kubernetes_reads_them() -> None:
    berlin = datetime.timezone(datetime.timedelta(hours=1))
    body = patch(told(), "w", datetime.datetime(2026, 11, 21, 11, 5, 0, 7, tzinfo=berlin))
    assert body["spec"]["renewTime"] == "2026-11-21T10:05:00.000007Z"
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{6}Z", body["spec"]["acquireTime"])


def test_nothing_is_written_before_anything_is_known() -> None:
    assert report(Sight(), 0.0) is None
    assert not due(Mirror(), None, 0.0)


def test_the_first_state_is_written_at_once_and_then_every_ten_seconds() -> None:
    assert due(Mirror(), told(), 100.0)
    mirror = succeeded(told(), 100.0)
    later = told(109.9, written="later", round_trip_ms={"p50": 50.0})
    assert not due(mirror, later, 100.0 + RENEW_S - 0.1)
    assert due(mirror, later, 100.0 + RENEW_S)


def test_a_transition_is_written_at_once() -> None:
    mirror = succeeded(told(), 100.0)
    changes: list[dict[str, Any]] = [{"site": "robot"}, {"connected": False}, {"epoch": 13}, {"settings": {}}]
    for change in changes:
        assert due(mirror, told(102.0, **change), 102.0)


def test_a_new_entry_of_the_audit_trail_waits_for_the_next_renewal() -> None:
    before, after = f"40:{'a' * 64}", f"41:{'b' * 64}"
    mirror = succeeded(told(audit=before), 100.0)
    assert not due(mirror, told(102.0, audit=after), 102.0)
    assert due(mirror, told(102.0, audit=after, site="robot"), 102.0)
    renewed = told(100.0 + RENEW_S, audit=after)
    assert due(mirror, renewed, 100.0 + RENEW_S)
    assert after in patch(renewed, "w", NOW)["metadata"]["annotations"][ANNOTATION]


def test_while_the_robot_is_gone_nothing_is_written() -> None:
    gone = told(connected=False)
    mirror = succeeded(gone, 100.0)
    assert not any(due(mirror, gone, 100.0 + second) for second in range(3600))


def test_a_silent_agent_is_told_once() -> None:
    sight = seen(100.0)
    silent = report(sight, 106.0)
    assert silent is not None
    state = json.loads(silent.text)
    assert (silent.connected, state["site"], state["ready"], state["reason"]) == (
        False,
        "unknown",
        False,
        "AgentSilent",
    )
    assert state["settings"]["robot_generation"] == 3
    assert report(sight, 900.0) == silent
    back = report(look(sight, text(written="later"), 901.0), 901.0)
    assert back is not None
    assert back.connected


def test_failures_are_tried_again_with_growing_pauses_and_the_newest_state() -> None:
    mirror, now_s, pauses = succeeded(told(), 100.0), 110.0, []
    for _ in range(8):
        assert due(mirror, told(now_s), now_s)
        mirror = failed(mirror, now_s)
        pauses.append(mirror.retry_s - now_s)
        assert not due(mirror, told(now_s, site="robot"), mirror.retry_s - 0.1)
        now_s = mirror.retry_s
    assert pauses == [1.0, 2.0, 4.0, 8.0, LONGEST_PAUSE_S, LONGEST_PAUSE_S, LONGEST_PAUSE_S, LONGEST_PAUSE_S]
    assert due(mirror, told(now_s, connected=False), now_s)  # a failure may hide a write that was lost half-way
    assert succeeded(told(), now_s).failures == 0


def test_acquiring_is_told_since_the_robot_connected() -> None:
    assert told().since == SINCE


@given(st.lists(st.tuples(st.floats(0.05, 5.0), st.sampled_from(["robot", "cloud"]), st.booleans()), max_size=60))
def test_however_the_state_flaps_writes_keep_their_distance(steps: list[tuple[float, str, bool]]) -> None:
    mirror, now_s, writes = Mirror(), 0.0, []
    for pause_s, site, works in steps:
        now_s += pause_s
        wanted = told(now_s, site=site)
        if due(mirror, wanted, now_s):
            writes.append(now_s)
            mirror = succeeded(wanted, now_s) if works else failed(mirror, now_s)
    assert all(b - a >= GAP_S - 1e-9 for a, b in itertools.pairwise(writes))
