"""A pin with an end: which pin is in force, whatever was written and however clocks are set."""

from __future__ import annotations

import datetime
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from robot_offload.api.v1alpha1 import pinned
from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload.api.v1alpha1.pinned import PINNED_UNTIL, Hold, hold, observed, read, written
from tests.integration.operator_cluster import walker

NOW = datetime.datetime(2026, 11, 23, 12, 0, tzinfo=datetime.UTC)
END = "Robot 2026-11-23T12:10:00Z"
PINS = st.sampled_from(["Auto", "Robot", "Cloud"])
TIMES = st.integers(946_684_800, 4_102_444_800).map(lambda at: datetime.datetime.fromtimestamp(at, datetime.UTC))
"""Of this century, in whole seconds."""


def manifest(pin: str, text: str | None, ended: str = "") -> dict[str, Any]:
    found = walker(switching={"pin": pin})
    if text is not None:
        found["metadata"]["annotations"] = {PINNED_UNTIL: text}
    return {**found, "status": {"pin": {"ended": ended}}}


def test_a_pin_holds_until_its_end_and_counts_no_more_from_then_on() -> None:
    at = datetime.datetime(2026, 11, 23, 12, 10, tzinfo=datetime.UTC)
    assert hold("Robot", END, "", at - datetime.timedelta(seconds=1)) == Hold("Robot", at, recheck_s=1.0)
    assert hold("Robot", END, "", at) == Hold("Auto", ended=END)


def test_without_an_end_or_with_that_of_another_side_a_pin_holds() -> None:
    for text in ("", "Cloud 2026-11-23T11:00:00Z", "when I am back", "2026-11-23T11:00:00Z"):
        assert hold("Robot", text, "", NOW) == Hold("Robot")
    assert hold("Auto", END, "", NOW) == Hold("Auto")


def test_what_has_ended_stays_ended_when_clocks_are_set_back_and_a_new_end_counts() -> None:
    before = NOW - datetime.timedelta(days=1)
    assert hold("Robot", END, END, before).side == "Auto"
    assert hold("Robot", "Robot 2026-11-23T12:20:00Z", END, before).side == "Robot"


def test_a_wait_for_an_end_is_never_longer_than_a_minute_because_clocks_are_set() -> None:
    assert hold("Robot", END, "", NOW).recheck_s == pinned.LOOK_S


@given(PINS, TIMES, TIMES)
def test_every_end_that_is_written_is_read(side: str, at: datetime.datetime, now: datetime.datetime) -> None:
    found = hold(side, written(side, at), "", now)
    assert found.side == (side if side == "Auto" or now < at else "Auto")


@given(PINS, st.text() | st.from_regex(r"(Robot|Cloud) [0-9T:.Z+-]{18,42}"), st.text(), TIMES)
def test_no_text_is_a_crash_and_what_is_no_end_ends_nothing(
    pin: str, text: str, ended: str, now: datetime.datetime
) -> None:
    found = hold(pin, text, ended, now)
    assert read(text) is not None or found == Hold(pin)
    seen = observed(manifest(pin, text, found.ended))
    assert (seen.side, seen.until, seen.ended) == (found.side, found.until, found.ended)


def test_the_resource_is_rendered_with_the_pin_that_is_in_force() -> None:
    offload = parse_object(manifest("Robot", END), "walker", unknown="ignore")
    assert pinned.held(offload, "Auto").spec.switching.pin == "Auto"
    assert pinned.held(offload, "Robot") is offload
    assert offload.spec.switching.pin == "Robot"


def test_an_end_that_is_none_is_a_warning_with_what_to_write() -> None:
    def found(text: str | None) -> list[str]:
        offload = parse_object(manifest("Robot", text), "walker", unknown="ignore")
        return [f"{each.severity} {each.line()}" for each in pinned.findings(offload)]

    assert found(None) == found(END) == []
    (said,) = found("soon")
    assert said.startswith("warning metadata.annotations[\"robotoffload.dev/pinned-until\"]: 'soon' is not a valid end")
    assert "write a side and a time, such as Robot 2026-11-23T12:10:00Z" in said
