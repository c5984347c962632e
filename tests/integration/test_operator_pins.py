"""Pins with an end under a running operator: in force, over, and ends that are none."""

from __future__ import annotations

import datetime
import re
from typing import Any

import pytest
import yaml

from robot_offload.api.v1alpha1.pinned import PINNED_UNTIL, written
from robot_offload.kube.kinds import CONFIG_MAP, ROBOT_OFFLOAD
from robot_offload.render.agent_workload import SETTINGS_KEY
from tests.integration.operator_cluster import Place, eventually, walker

pytestmark = pytest.mark.api


def later(side: str, seconds: float) -> str:
    return written(side, datetime.datetime.now(datetime.UTC) + datetime.timedelta(seconds=seconds))


def pushed(place: Place) -> str:
    """The pin in the settings that the cloud's agent offers to the robot."""
    texts = [(each.get("data") or {}).get(SETTINGS_KEY) for each in place.list(CONFIG_MAP)]
    (text,) = [each for each in texts if each]
    return str(yaml.safe_load(text)["/**"]["ros__parameters"]["pin"])


def changed_by(place: Place) -> str:
    """Who changed the settings, as the robot's audit trail is going to say."""
    (text,) = [text for each in place.list(CONFIG_MAP) if (text := (each.get("data") or {}).get(SETTINGS_KEY))]
    return str(yaml.safe_load(text).get("changed_by"))


def pin_status(place: Place) -> dict[str, Any]:
    found: dict[str, Any] = (place.roff().get("status") or {}).get("pin") or {}
    return found


def annotate(place: Place, text: str | None) -> None:
    place.patch(ROBOT_OFFLOAD, "walker", {"metadata": {"annotations": {PINNED_UNTIL: text}}})


def test_a_pin_ends_with_nobody_looking_and_nobody_writes_the_specification(place: Place) -> None:
    manifest = walker(switching={"pin": "Robot"})
    manifest["metadata"]["annotations"] = {PINNED_UNTIL: later("Robot", 3600)}
    place.create(ROBOT_OFFLOAD, manifest)
    place.applied()
    assert pushed(place) == "Robot"
    assert pin_status(place)["side"] == "Robot"
    assert pin_status(place)["until"]
    end = later("Robot", 2)
    annotate(place, end)
    eventually(lambda: pushed(place) == "Auto", "the pin to end")
    eventually(lambda: pin_status(place) == {"side": "Auto", "ended": end}, "the status", lambda: pin_status(place))
    eventually(lambda: "PinEnded" in {event["reason"] for event in place.events()}, "the event")
    roff = place.roff()
    # Whoever created it is named, too, when that was within the same second.
    who = rf"(Python-urllib or )?somebody at [0-9TZ:-]+; the end of the pin: {end}"
    eventually(lambda: re.fullmatch(who, changed_by(place)), "who it was", lambda: changed_by(place))
    assert roff["spec"]["switching"]["pin"] == "Robot"
    assert roff["metadata"]["generation"] == 1
    writers = {each["manager"] for each in roff["metadata"]["managedFields"] if not each.get("subresource")}
    assert "robot-offload-operator" not in writers
    # Who takes the end away pins again; the end of another side's pin, and what is no end, ends nothing.
    annotate(place, None)
    eventually(lambda: pushed(place) == "Robot" and pin_status(place) == {"side": "Robot"}, "the pin to hold again")
    annotate(place, later("Cloud", -60))
    annotate(place, "when I am back")
    eventually(
        lambda: "'when I am back' is not a valid end of a pin" in place.condition("SpecValid")["message"],
        "the sentence about what is no end",
        lambda: place.condition("SpecValid"),
    )
    assert place.condition("SpecValid")["status"] == "True"
    assert pushed(place) == "Robot"


def test_the_head_of_the_robots_audit_trail_is_kept_in_the_status(place: Place) -> None:
    place.create(ROBOT_OFFLOAD, walker())
    place.applied()
    head = f"41:{'5b1f' * 16}"
    place.renew(site="robot", reason="LinkBad", audit=head)
    found = eventually(lambda: place.roff()["status"].get("audit"), "the head")
    assert (found["entries"], found["head"]) == (41, head)
    place.renew(site="cloud", reason="LinkGood", audit="nonsense")
    eventually(lambda: place.roff()["status"]["placement"] == "Cloud", "the next state")
    assert place.roff()["status"]["audit"] == found
    # Within the minute a newer head waits; the minute counts from the status.
    place.patch(ROBOT_OFFLOAD, "walker", {"status": {"audit": {"seen": "2026-01-01T00:00:00Z"}}}, "status")
    cut = f"7:{'00' * 32}"
    place.renew(site="cloud", reason="LinkGood", audit=cut)
    eventually(lambda: place.roff()["status"]["audit"]["head"] == cut, "the newer head")
    eventually(lambda: "AuditTrailRestarted" in {event["reason"] for event in place.events()}, "the warning")
