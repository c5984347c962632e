"""The robot's own numbers on the data session: passed on small and few, never trusted."""

from __future__ import annotations

from typing import Any

from robot_offload_core.data.cloud import REPORT_PERIOD_S, CloudDataProcess
from robot_offload_core.data.process import MAX_REPORT, REPORT, DataPlan
from robot_offload_core.data.robot import RobotDataProcess
from robot_offload_core.words.messages import Reported
from tests.unit.core.data.test_probes import Side


class Ends(Side):
    """Surroundings that keep what is sent to control, and every channel of the link."""

    def __init__(self) -> None:
        super().__init__()
        self.told: list[object] = []
        self.channels: list[tuple[str, Any]] = []

    def send(self, to: str, message: object) -> bool:
        if to == "control" and isinstance(message, Reported):
            self.told.append(message)
        return True

    def cross(self, channel: str, header: bytes, payload: Any) -> bool:
        self.channels.append((channel, payload))
        return super().cross(channel, header, payload)


def test_a_report_of_control_crosses_as_it_is() -> None:
    side = Ends()
    RobotDataProcess(DataPlan((), ()), side).handle(Reported('{"version":1}'))
    assert side.channels == [(REPORT, b'{"version":1}')]


def test_the_cloud_passes_small_reports_and_few() -> None:
    side = Ends()
    cloud = CloudDataProcess(DataPlan((), ()), side)
    for payload in (b"a", b"b", b"x" * (MAX_REPORT + 1), b"\xff"):
        cloud.arrived(REPORT, b"-", payload)
    side.time_s += REPORT_PERIOD_S
    cloud.arrived(REPORT, b"-", b"\xff")
    cloud.arrived(REPORT, b"-", b"c")
    assert side.told == [Reported("a"), Reported("c")]
    assert cloud.counters["garbage.report"] == 4


def test_a_report_that_the_cloud_sends_reaches_nobody() -> None:
    side = Ends()
    robot = RobotDataProcess(DataPlan((), ()), side)
    robot.arrived(REPORT, b"-", b"{}")
    assert side.told == []
    assert robot.counters["garbage.report"] == 1
