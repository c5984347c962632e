"""What a person does on a page, as a change of the resource; and why a button does nothing."""

from __future__ import annotations

import datetime

from robot_offload.api.v1alpha1.pinned import PINNED_UNTIL
from robot_offload.console.actions import Action, Want, done, patch, useless
from robot_offload.insight.observed import Observed, observe

NOW = datetime.datetime(2026, 11, 23, 12, 0, tzinfo=datetime.UTC)


def observed(pin: str = "Auto", mode: str = "Auto", connected: bool = True, until: str = "") -> Observed:
    return observe(
        {
            "metadata": {"name": "w", "generation": 4, "annotations": {PINNED_UNTIL: until}},
            "spec": {"switching": {"pin": pin, "mode": mode}},
            "status": {"robot": {"connected": connected}},
        }
    )


def test_a_pin_with_an_end_says_when_it_ends() -> None:
    body = patch(Action(Want.PIN_CLOUD, 600.0), "uid", NOW)
    assert body["spec"] == {"switching": {"pin": "Cloud"}}
    assert body["metadata"] == {"uid": "uid", "annotations": {PINNED_UNTIL: "Cloud 2026-11-23T12:10:00Z"}}


def test_letting_go_takes_the_end_away() -> None:
    body = patch(Action(Want.AUTO, 600.0), "uid", NOW)
    assert body["metadata"] == {"uid": "uid", "annotations": {PINNED_UNTIL: None}}
    assert body["spec"] == {"switching": {"pin": "Auto"}}


def test_taking_over_now_holds_the_robot_for_a_minute() -> None:
    body = patch(Action(Want.TAKE_OVER), "uid", NOW)
    assert body["spec"] == {"switching": {"pin": "Robot"}}
    assert body["metadata"]["annotations"] == {PINNED_UNTIL: "Robot 2026-11-23T12:01:00Z"}


def test_observing_changes_the_mode_and_no_pin() -> None:
    assert patch(Action(Want.OBSERVE), "uid", NOW) == {
        "metadata": {"uid": "uid"},
        "spec": {"switching": {"mode": "Observe"}},
    }


def test_a_button_that_would_change_nothing_says_so() -> None:
    assert useless(Action(Want.AUTO), observed()) == "the pin is Auto already"
    assert useless(Action(Want.SWITCH), observed()) == "the mode is Auto already"
    assert useless(Action(Want.PIN_ROBOT), observed()) == ""
    assert useless(Action(Want.PIN_ROBOT, 60.0), observed("Robot")) == ""  # an end is new
    assert useless(Action(Want.PIN_ROBOT), observed("Robot", until="Robot 2030-01-01T00:00:00Z")) == ""  # no end is new
    assert useless(Action(Want.TAKE_OVER), None) == "there is no resource to change"


def test_what_was_done_is_told_with_what_it_means_now() -> None:
    said = done(Action(Want.PIN_ROBOT, 600.0), observed("Robot", connected=False))
    assert (
        said
        == "w: held on the robot for 10 min; generation 4; the robot is not connected and hears it when it connects"
    )
    assert "decides and never switches" in done(Action(Want.OBSERVE), observed(mode="Observe"))
