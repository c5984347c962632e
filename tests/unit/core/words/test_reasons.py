"""What a reason implies, in a table: decisions ask these properties and compare no text."""

from __future__ import annotations

import json

import pytest

from robot_offload_core.words.reasons import Kind, Reason


def test_a_reason_is_written_as_its_word_everywhere() -> None:
    reason = Reason.HEARTBEAT_LOST
    assert (str(reason), f"{reason}", "%s" % reason, json.dumps(reason)) == (*["HeartbeatLost"] * 3, '"HeartbeatLost"')  # noqa: UP031
    assert Reason("HeartbeatLost") is reason


def test_a_reason_finds_what_is_kept_under_its_word() -> None:
    assert {"HeartbeatLost": 1}[Reason.HEARTBEAT_LOST] == 1


@pytest.mark.parametrize("reason", Reason, ids=str)
def test_every_reason_says_its_cause_in_one_sentence_part(reason: Reason) -> None:
    assert reason.cause[0].isupper()
    assert not reason.cause.endswith(".")
    assert not reason.advice.endswith(".")


def test_who_waits_for_no_dwell() -> None:
    vetoes = {
        "SecondPublisher", "TwoReplicas", "UndeclaredPublisher", "SecondLifecycleManager", "SecondSession",
    }  # fmt: skip
    urgent = {"ByHand", "PinnedToRobot", "PinnedToCloud", "ClockOffset", "PodStopping"} | vetoes
    assert {r.value for r in Reason if r.urgent} == urgent
    assert {r.value for r in Reason if r.chosen} == urgent | {"RobotPreferred"}


def test_who_lets_a_robot_stand_still_rather_than_the_cloud_act() -> None:
    vetoes = {r.value for r in Reason if r.kind is Kind.VETO and r is not Reason.POD_STOPPING}
    assert {r.value for r in Reason if not r.yields_to_need} == {"PinnedToRobot", "PinnedToCloud"} | vetoes


def test_hard_limits_are_no_ones_wish() -> None:
    assert not any(r.chosen for r in Reason if r.kind is Kind.LIMIT)
