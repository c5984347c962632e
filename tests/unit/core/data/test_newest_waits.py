"""A message that waits for room is thinned only when the next one takes its place."""

from __future__ import annotations

from typing import Any

from robot_offload_core.data.process import DataPlan, InputPlan
from robot_offload_core.data.robot import RobotDataProcess
from tests.unit.core.data.test_states import Ports

PERIOD_S = 0.1


class FullAtTimes(Ports):
    """A link that refuses messages while `full`."""

    full = False

    def cross(self, channel: str, header: bytes, payload: Any) -> bool:
        return not self.full and super().cross(channel, header, payload)

    def link_status(self) -> tuple[bool, str]:
        return True, ""


def data_of(ports: Ports) -> RobotDataProcess:
    return RobotDataProcess(DataPlan((InputPlan("camera", min_rate_hz=3.0, latest=True),), ()), ports)


def test_a_message_that_is_sent_before_the_next_one_comes_slows_nothing() -> None:
    ports = FullAtTimes()
    data = data_of(ports)
    for number in range(100):
        ports.time_s += PERIOD_S
        ports.full = number % 3 == 0  # a packet of the message before was lost
        data.forward("camera", b"image")
        ports.full = False
        data.room("camera")
    assert len(ports.crossed) == 100
    assert data.paces.of["camera"].least_s == 0.0


def test_a_message_whose_place_is_taken_shows_that_the_link_carries_too_little() -> None:
    ports = FullAtTimes()
    data = data_of(ports)
    for number in range(50):
        ports.time_s += PERIOD_S
        ports.full = number % 3 != 0
        data.forward("camera", b"image")
    assert data.paces.of["camera"].least_s > PERIOD_S
    assert data.counters["camera.thinned"] > 0
