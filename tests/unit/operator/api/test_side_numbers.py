"""The numbers of a side, read without trust."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_offload.api import side_numbers
from robot_offload.api.side_numbers import SideNumbers, parse_numbers
from robot_offload_core.control.tallies import LATENCY_MS
from robot_offload_core.topics.tallies import GAP_MS
from tests.unit.operator.reporter.states import REPORT, seen


def test_a_whole_report_is_read() -> None:
    found = parse_numbers(REPORT)
    assert found is not None
    assert (found.garbage, found.beats_lost, found.false_alarms, found.silence_s) == (0, 7, 1, 0.19)
    assert found.goals == (("/go", (3, 0, 1)),)
    assert (found.actions, found.services) == ((("/go", (1, 2, 4)),), (("/plan", 3),))
    assert (found.used_goals, found.used_calls) == (1, 0)


def test_an_agent_that_says_no_numbers_has_none() -> None:
    assert parse_numbers(None) is None
    assert parse_numbers("numbers") is None
    assert parse_numbers({}) == SideNumbers()


ELSEWHERE = {"version", "release", "site", "phase", "limit_ms", "nodes", "ages", "changeover"}
"""Parts that are no numbers for metrics: the console reads them."""


@pytest.mark.parametrize("part", sorted(REPORT.keys() - ELSEWHERE))
@pytest.mark.parametrize("spoiled", ["x", {"a": {}}, [1, "x"], -1e300, [[]]])
def test_a_part_of_another_form_is_counted_and_the_others_stand(part: str, spoiled: Any) -> None:
    found = parse_numbers(REPORT | {part: spoiled})
    assert found is not None
    assert found.garbage == 1
    assert found.beats_lost == (None if part == "beats" else 7)


PLAIN = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5)
ANY = st.recursive(
    PLAIN, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=4)
)


@given(st.dictionaries(st.sampled_from(sorted(REPORT)), ANY, max_size=8))
def test_no_report_spoils_the_state_around_it(report: dict[str, Any]) -> None:
    found = seen(100.0, robot=json.loads(json.dumps(report)))
    assert found.problem == ""
    assert found.state is not None


def test_agent_and_reporter_count_by_the_same_bounds() -> None:
    assert [round(bound * 1e3) for bound in side_numbers.LATENCY_S] == list(LATENCY_MS)
    assert [round(bound * 1e3) for bound in side_numbers.GAP_S] == list(GAP_MS)
