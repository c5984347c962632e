"""Who is alive is said in a hundred bytes; what is held goes whole until the other side says that it has it."""

from __future__ import annotations

import threading
from contextlib import AbstractContextManager
from typing import Any

import pytest

from robot_offload_core.data import probe
from robot_offload_core.data.cloud import CloudDataProcess
from robot_offload_core.data.probe import PROBE_PERIOD_S, Probe, Sign
from robot_offload_core.data.process import DataPlan, DataProcess
from robot_offload_core.data.robot import OTHERS_AFTER_S, RobotDataProcess
from robot_offload_core.words.events import SetEgress
from robot_offload_core.words.messages import Egress, Heard, Orders

ROBOT, CLOUD, OTHER = "ab" * 16, "cd" * 16, "ef" * 16


class Side:
    """One side's surroundings: what it sends over the link is kept."""

    def __init__(self) -> None:
        self.time_s = 100.0
        self.crossed: list[bytes] = []
        self._lock = threading.Lock()

    @property
    def lock(self) -> AbstractContextManager[Any]:
        return self._lock

    def now_s(self) -> float:
        return self.time_s

    def send(self, to: str, message: object) -> bool:
        del to, message
        return True

    def renew(self, to: str, message: object) -> bool:
        return self.send(to, message)

    def carry(self, to: str, kind: bytes, index: int, header: bytes, payload: Any) -> bool:
        del to, kind, index, header, payload
        return True

    def cross(self, channel: str, header: bytes, payload: Any) -> bool:
        del header
        if channel == "probe":
            self.crossed.append(payload)
        return True

    def link_status(self) -> tuple[bool, str]:
        return True, ""

    def reopen(self, reason: str) -> None:
        del reason

    def types(self) -> dict[str, str]:
        return {}

    def warn(self, message: str) -> None:
        raise AssertionError(message)

    def publish_output(self, index: int, payload: Any) -> None:
        del index, payload

    def publish_input(self, name: str, payload: Any) -> bool:
        del name, payload
        return True


class Pair:
    """A robot's and a cloud's data process and what is lost between them."""

    def __init__(self) -> None:
        self.sides = Side(), Side()
        plan = DataPlan((), ())
        self.robot = RobotDataProcess(plan, self.sides[0])
        self.cloud = CloudDataProcess(plan, self.sides[1])
        self.robot.handle(Orders(ROBOT, 1))
        self.state("inactive")

    def state(self, state: str) -> None:
        self.cloud.handle(Egress(CLOUD, ROBOT, SetEgress(None, 0.0), (("walker", state),)))

    def turn(self, *, lost: bool = False) -> list[Probe | Sign]:
        """A tenth of a second passes; returns what the cloud sent, which is lost if so asked."""
        said: list[bytes] = []
        processes: tuple[DataProcess, DataProcess] = self.robot, self.cloud
        for side, process in zip(self.sides, processes, strict=True):
            side.time_s += PROBE_PERIOD_S
            side.crossed.clear()
            process.turn()
        for payload in self.sides[0].crossed:
            self.cloud.arrived("probe", b"-", payload)
        for payload in self.sides[1].crossed:
            said.append(payload)
            if not lost:
                self.robot.arrived("probe", b"-", payload)
        return [probe.decode(payload) for payload in said]


@pytest.fixture
def pair() -> Pair:
    found = Pair()
    for _ in range(5):
        found.turn()
    return found


def kinds(said: list[list[Probe | Sign]]) -> list[str]:
    return [type(one).__name__ for turn in said for one in turn]


def test_what_does_not_change_goes_whole_once_a_second(pair: Pair) -> None:
    said = kinds([pair.turn() for _ in range(30)])
    assert said.count("Probe") == 3
    assert pair.robot.probe is not None
    assert pair.robot.probe.nodes == {"walker": "inactive"}


def test_a_change_goes_whole_until_the_other_side_has_it(pair: Pair) -> None:
    pair.state("active")
    assert kinds([pair.turn(lost=True) for _ in range(4)]) == ["Probe"] * 4
    pair.turn()
    assert pair.robot.probe is not None
    assert pair.robot.probe.nodes == {"walker": "active"}
    pair.turn()
    assert kinds([pair.turn()]) == ["Sign"]


def test_a_sign_alone_keeps_the_session_alive(pair: Pair) -> None:
    while kinds([pair.turn()]) != ["Sign"]:
        pass
    assert pair.robot.probe_age_s(pair.sides[0].time_s) == 0.0


def test_a_side_that_starts_anew_gets_what_is_held_at_once(pair: Pair) -> None:
    pair.robot = RobotDataProcess(DataPlan((), ()), pair.sides[0])
    pair.robot.handle(Orders(ROBOT, 1))
    for _ in range(3):
        pair.turn()
    assert pair.robot.probe is not None
    assert pair.robot.probe.nodes == {"walker": "inactive"}


def test_a_sign_of_somebody_whose_holdings_are_unknown_proves_no_session(pair: Pair) -> None:
    pair.robot.probe_s = None
    pair.robot.arrived("probe", b"-", probe.encode(Sign(OTHER, "x", "y")))
    assert pair.robot.probe_age_s(pair.sides[0].time_s) is None
    assert pair.robot.counters["probe.unknown"] == 1


def test_of_two_clouds_the_one_that_the_pulse_hears_counts_while_it_is_heard(pair: Pair) -> None:
    pair.robot.handle(Heard(CLOUD, 1, pair.sides[0].time_s))
    stranger = probe.encode(probe.signed(Probe(OTHER), ""))
    pair.robot.arrived("probe", b"-", stranger)
    assert pair.robot.probe is not None
    assert pair.robot.probe.incarnation == CLOUD
    pair.sides[0].time_s += OTHERS_AFTER_S + 0.01
    pair.robot.arrived("probe", b"-", stranger)
    assert pair.robot.probe.incarnation == OTHER
