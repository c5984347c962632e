"""The robot's own numbers on their way to the cloud."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_offload_agent.settings.robot_report import ReportError, decode, encode
from robot_offload_core.data.process import MAX_REPORT

ROBOT = "ab" * 16
TOPICS = {"scan": "/scan"}


def test_what_is_encoded_is_read_with_the_names_that_people_know() -> None:
    text = encode(ROBOT, {"ready": True}, {"topics": {"scan": [1, 0, 0, 0], "other": [1, 0, 0, 0]}})
    found = decode(text, ROBOT, TOPICS)
    assert (found["ready"], found["topics"], found["left_out"]) == (True, {"/scan": [1, 0, 0, 0]}, 0)
    assert "incarnation" not in found


def test_a_robot_of_two_hundred_topics_stays_within_two_kilobytes() -> None:
    many = {f"camera_{number}_depth_image_points": [10**9, 10**6, 10**6, 10**6] for number in range(200)}
    text = encode(ROBOT, {"latency": [10**9] * 15}, {"topics": many, "nodes": {"n": "active"}})
    assert len(text.encode()) <= MAX_REPORT
    found = decode(text, ROBOT, {name: name for name in many})
    assert found["left_out"] == 200 - len(found["topics"])
    assert found["topics"]


def test_the_longest_list_makes_room_and_the_others_stay() -> None:
    many = {f"camera_{number}_depth_image_points": 10**6 for number in range(200)}
    lists = {"goals": {"go": [1, 2, 3]}, "ages": many, "topics": {"scan": [1, 2, 3, 4]}}
    found = decode(encode(ROBOT, {"latency": [10**9] * 15}, lists), ROBOT, {"scan": "/scan", **{n: n for n in many}})
    assert found["goals"] == {"go": [1, 2, 3]}
    assert found["topics"] == {"/scan": [1, 2, 3, 4]}
    assert 8 <= len(found["ages"]) < 200
    assert found["left_out"] == 200 - len(found["ages"])


LISTS = st.dictionaries(st.text(), st.integers() | st.text(), max_size=40)


@given(st.dictionaries(st.text(max_size=8), LISTS, max_size=8))
def test_a_report_of_any_names_is_bounded(lists: dict[str, dict[str, Any]]) -> None:
    text = encode(ROBOT, {}, lists)
    assert len(text.encode()) <= MAX_REPORT
    json.loads(text)


def reports(**changes: Any) -> str:
    return json.dumps({"version": 1, "incarnation": ROBOT, **changes})


@pytest.mark.parametrize(
    "text", ["", "[]", "nonsense", "1", '{"version": 1}', reports(incarnation="cd" * 16), "[" * 1990,
             reports(topics=[[[[[[]]]]]])]
)  # fmt: skip
def test_what_is_no_report_of_this_robot_is_refused(text: str) -> None:
    with pytest.raises(ReportError) as refused:
        decode(text, ROBOT, TOPICS)
    assert refused.value.reason in ("BadForm", "OtherVersion")


def test_a_later_version_is_refused_in_words() -> None:
    with pytest.raises(ReportError, match="install the same release") as refused:
        decode(reports(version=2), ROBOT, TOPICS)
    assert refused.value.reason == "OtherVersion"


def test_numbers_that_are_none_do_not_reach_the_file() -> None:
    assert decode(reports(latency_ms=float("nan")), ROBOT, TOPICS)["latency_ms"] is None
