"""What the cloud's agent does for the operator: state in, event, state out."""

from __future__ import annotations

from typing import Any

from robot_offload_agent.settings import liaison
from robot_offload_agent.settings.liaison import LEAVING_S, HandoverAsked, Liaison, RobotSaid, Seen, SettingsRead
from robot_offload_agent.settings.notes import RobotNotes
from robot_offload_agent.settings.offer import Offer
from robot_offload_core.link.momentary import Glance

WALL, LATER = "2026-11-21T22:00:00.000Z", "2026-11-21T23:00:00.000Z"
OFFER = Offer(7, {"pin": "Robot"})
ACCEPTED = RobotNotes(7, OFFER.digest, True, "Accepted", "The robot runs generation 7", "", "cloud", "LinkGood", "good")
REFUSED = RobotNotes(6, OFFER.digest, False, "Invalid", "parameter pin: ...", "", "cloud", "LinkGood", "good")


def after(*events: liaison.Event, start: Liaison | None = None, now_s: float = 10.0) -> Liaison:
    state = start or Liaison(watched=True, since=WALL)
    for event in events:
        state = liaison.step(state, event, now_s)
    return state


def told(state: Liaison) -> dict[str, Any]:
    return liaison.state(state, generation=7, epoch=3, nodes=[("walker", "active")], ready=True)


CONNECTED = after(Seen(True, WALL))


# -- settings


def test_settings_are_offered_until_the_robot_has_answered_to_exactly_them() -> None:
    state = after(SettingsRead(OFFER), start=CONNECTED)
    assert liaison.notes(state, 10.0).offer == OFFER
    assert liaison.notes(after(RobotSaid(RobotNotes(6, "other")), start=state), 10.0).offer == OFFER
    for answer in (ACCEPTED, REFUSED):
        assert liaison.notes(after(RobotSaid(answer), start=state), 10.0).offer is None


def test_settings_that_the_robot_could_not_keep_are_offered_again() -> None:
    answer = RobotNotes(6, OFFER.digest, False, "NotKept", "the disk is full")
    state = after(SettingsRead(OFFER), RobotSaid(answer), start=CONNECTED)
    assert liaison.notes(state, 10.0).offer == OFFER
    assert told(state)["settings"]["reason"] == "NotKept"


def test_newer_settings_are_offered_again() -> None:
    state = after(SettingsRead(OFFER), RobotSaid(ACCEPTED), SettingsRead(Offer(8, {})), start=CONNECTED)
    assert liaison.notes(state, 10.0).offer == Offer(8, {})
    assert told(state)["settings"]["reason"] == "Pending"


def test_a_robot_that_comes_back_is_asked_again() -> None:
    state = after(SettingsRead(OFFER), RobotSaid(ACCEPTED), Seen(False, LATER), Seen(True, LATER), start=CONNECTED)
    assert liaison.notes(state, 10.0).offer == OFFER
    assert liaison.taken(state) is None


def test_only_settings_that_the_robot_has_taken_hold_in_the_cloud() -> None:
    state = after(SettingsRead(OFFER), start=CONNECTED)
    assert liaison.taken(state) is None
    assert liaison.taken(after(RobotSaid(REFUSED), start=state)) is None
    assert liaison.taken(after(RobotSaid(ACCEPTED), start=state)) == OFFER


def test_the_answer_is_told_with_the_generation_that_the_robot_runs() -> None:
    state = after(SettingsRead(OFFER), RobotSaid(REFUSED), start=CONNECTED)
    assert told(state)["settings"] == {
        "robot_generation": 6, "accepted": False, "reason": "Invalid", "message": "parameter pin: ...",
    }  # fmt: skip


def test_a_file_that_cannot_be_read_offers_nothing_and_is_told() -> None:
    state = after(SettingsRead(None, "settings_file: not YAML"), RobotSaid(ACCEPTED), start=CONNECTED)
    assert liaison.notes(state, 10.0).offer is None
    settings = told(state)["settings"]
    assert (settings["accepted"], settings["reason"]) == (None, "SettingsUnreadable")
    assert settings["message"] == "settings_file: not YAML"


def test_without_a_settings_file_nothing_is_offered_and_the_generation_is_known_all_the_same() -> None:
    state = after(Seen(True, WALL), RobotSaid(ACCEPTED), start=Liaison())
    settings = told(state)["settings"]
    assert (settings["robot_generation"], settings["accepted"], settings["reason"]) == (7, None, "NotOffered")


# -- handing over


def test_handing_over_is_answered_once_the_robot_acts_and_not_before() -> None:
    state = after(RobotSaid(ACCEPTED), HandoverAsked("end"), start=CONNECTED)
    assert liaison.notes(state, 10.0).leaving == "end"
    assert told(state)["handover"] == ""
    obeyed = RobotNotes(7, left="end", site="cloud")
    state = after(RobotSaid(obeyed), start=state)
    assert told(state)["handover"] == ""
    assert told(after(RobotSaid(RobotNotes(7, left="end", site="robot")), start=state))["handover"] == "end"


def test_a_robot_that_acts_already_must_still_know_that_the_cloud_is_leaving() -> None:
    state = after(RobotSaid(RobotNotes(7, site="robot")), HandoverAsked("end"), start=CONNECTED)
    assert told(state)["handover"] == ""


def test_with_no_robot_handing_over_is_answered_at_once() -> None:
    assert told(after(Seen(False, WALL), HandoverAsked("end")))["handover"] == "end"


def test_a_robot_that_is_lost_meanwhile_acts() -> None:
    state = after(HandoverAsked("end"), Seen(False, LATER), start=CONNECTED)
    assert told(state)["handover"] == "end"


def test_a_second_end_is_asked_for_and_answered_on_its_own() -> None:
    state = after(HandoverAsked("end"), RobotSaid(RobotNotes(left="end")), HandoverAsked("next"), start=CONNECTED)
    assert liaison.notes(state, 10.0).leaving == "next"
    assert told(state)["handover"] == "end"


def test_the_end_is_told_for_its_time_and_no_longer() -> None:
    state = after(HandoverAsked("end"), start=CONNECTED)
    assert liaison.notes(state, 10.0 + LEAVING_S - 0.1).leaving == "end"
    assert liaison.notes(state, 10.0 + LEAVING_S).leaving == ""


# -- the state


def test_the_state_tells_who_acts_in_the_robots_words() -> None:
    state = told(after(RobotSaid(ACCEPTED), start=CONNECTED))
    assert (state["site"], state["reason"], state["message"]) == ("cloud", "LinkGood", "good")
    assert (state["version"], state["agent_generation"], state["epoch"], state["ready"]) == (1, 7, 3, True)
    assert state["nodes"] == [{"name": "walker", "state": "active"}]


def test_nobody_knows_who_acts_while_no_robot_is_heard() -> None:
    state = told(after(RobotSaid(ACCEPTED), Seen(False, LATER), start=CONNECTED))
    assert (state["connected"], state["since"], state["site"]) == (False, LATER, "unknown")
    assert state["reason"] == "RobotNotConnected"
    assert told(CONNECTED)["reason"] == "Connecting"


def test_since_changes_with_the_connection_only() -> None:
    assert told(after(Seen(True, LATER), start=CONNECTED))["since"] == WALL
    assert liaison.figures(None, Glance(), (), {}) == {
        "round_trip_ms": {"p50": None, "p99": None},
        "link": {"latency_ms": None, "loss_share": None, "age_ms": None, "up_ms": None, "down_ms": None},
        "carried": [],
        "state_ages": [],
    }


def test_the_ages_of_the_state_are_told() -> None:
    ages = liaison.figures(None, Glance(), (), {"slam_1": 85, "amcl_1": 12})["state_ages"]
    assert ages == [{"name": "amcl_1", "age_ms": 12}, {"name": "slam_1", "age_ms": 85}]


def test_the_bytes_of_the_topics_that_carried_most_are_told() -> None:
    many = [liaison.Carried(f"/topic_{number:03d}", "to_cloud", number, 1) for number in range(200)]
    carried = liaison.figures(None, Glance(), many, {})["carried"]
    assert len(carried) == liaison.MAX_TOPICS
    one = {"topic": "/topic_199", "direction": "to_cloud", "bytes": 199, "messages": 1, "age_ms": None}
    assert carried[-1] == one
