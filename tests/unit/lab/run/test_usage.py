"""How much of the computer was in use between two readings."""

from __future__ import annotations

import psutil
import pytest

from robot_offload_lab.run.usage import ProcessorTime, busy_share, percent


@pytest.mark.parametrize(("idle_s", "share"), [(20.0, 0.0), (0.0, 1.0), (5.0, 0.75), (25.0, 0.0), (-1.0, 1.0)])
def test_what_no_core_was_idle_in_was_in_use(monkeypatch: pytest.MonkeyPatch, idle_s: float, share: float) -> None:
    monkeypatch.setattr(psutil, "cpu_count", lambda: 2)
    assert busy_share(ProcessorTime(10.0, {}, 100.0), ProcessorTime(20.0, {}, 100.0 + idle_s)) == share


def test_a_program_that_has_ended_in_between_has_no_share() -> None:
    before, after = ProcessorTime(0.0, {"agent": 1.0, "gone": 2.0}, 0.0), ProcessorTime(10.0, {"agent": 3.0}, 0.0)
    assert percent(before, after) == {"agent": 20.0}
