"""The schedule of a link on a robot's wire."""

from __future__ import annotations

import threading
from typing import Any

import pytest

from robot_offload_lab.wire.options import LinkOptions
from robot_offload_lab.wire.schedule import outage
from tests.e2e.weather import Weather


class WireThatRemembers:
    """What was set on it; `changed` after each third setting."""

    def __init__(self) -> None:
        self.settings: list[dict[str, Any]] = []
        self.mended = threading.Event()

    def set(self, **conditions: Any) -> None:
        self.settings.append(conditions)
        if [each["cut"] for each in self.settings[-2:]] == ["both", None]:
            self.mended.set()


def test_an_outage_cuts_the_wire_and_mends_it() -> None:
    wire = WireThatRemembers()
    schedule = LinkOptions(delay="5ms", loss="3%").schedule()
    weather = Weather(wire, type(schedule)((*schedule.parts, outage(0.05, 0.1))))  # type: ignore[arg-type]
    weather.start()
    assert wire.mended.wait(30)
    weather.stop()
    quiet = {"delay_ms": 5.0, "jitter_ms": 0.0, "loss_pct": pytest.approx(3.0), "cut": None}
    assert wire.settings[0] == quiet, "before the schedule starts the link is as it usually is"
    assert wire.settings[1]["cut"] == "both"
    assert wire.settings[-1] == quiet, "and so it is afterwards"


def test_nothing_is_set_while_nothing_changes() -> None:
    wire = WireThatRemembers()
    weather = Weather(wire, LinkOptions(delay="5ms").schedule())  # type: ignore[arg-type]
    weather.start()
    weather.stop()
    weather.stop()
    assert len(wire.settings) == 1


def test_a_link_that_differs_by_direction_is_refused() -> None:
    with pytest.raises(AssertionError, match="both ways"):
        Weather(WireThatRemembers(), LinkOptions(delay="5ms/20ms").schedule())  # type: ignore[arg-type]
