"""Latched values are hashed once, however often the sides compare what they hold."""

from __future__ import annotations

import threading
from typing import Any

from robot_offload_core.data import probe
from robot_offload_core.data.process import DataPlan, InputPlan
from robot_offload_core.data.robot import RobotDataProcess


class Surroundings:
    """What a data process needs: nothing is connected, time stands still."""

    def __init__(self) -> None:
        self.lock = threading.Lock()

    def now_s(self) -> float:
        return 100.0

    def send(self, to: str, message: object) -> bool:
        del to, message
        return False

    def renew(self, to: str, message: object) -> bool:
        return self.send(to, message)

    def carry(self, to: str, kind: bytes, index: int, header: bytes, payload: Any) -> bool:
        del to, kind, index, header, payload
        return False

    def cross(self, channel: str, header: bytes, payload: Any) -> bool:
        del channel, header, payload
        return False

    def link_status(self) -> tuple[bool, str]:
        return False, ""

    def reopen(self, reason: str) -> None:
        del reason

    def types(self) -> dict[str, str]:
        return {}

    def warn(self, message: str) -> None:
        raise AssertionError(message)


class Counted(bytes):
    """A value that knows how often its length was asked for, which is once for each hash."""

    asked = 0

    def __len__(self) -> int:
        Counted.asked += 1
        return super().__len__()


def test_a_value_is_hashed_once_until_another_one_comes() -> None:
    process = RobotDataProcess(DataPlan((InputPlan("map", latched=True),), ()), Surroundings())
    for value in (b"one map", b"another map"):
        process.forward("map", Counted(value))
        Counted.asked = 0
        for _ in range(50):
            assert process.make_probe().latched == {"map": probe.digest([value])}
            process.probed(probe.Probe("ab" * 16))
        assert Counted.asked == 1
