"""Inputs on their way to the replicas: each once, in the order in which the robot sent them."""

from __future__ import annotations

import threading
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from robot_offload_core.data.cloud import CloudDataProcess
from robot_offload_core.data.process import DataPlan, InputPlan
from robot_offload_core.words import envelope
from robot_offload_core.words.envelope import Envelope
from robot_offload_core.words.events import SetEgress
from robot_offload_core.words.messages import Egress
from robot_offload_core.words.token import Token

ROBOT, CLOUD = "1" * 32, "2" * 32


class Ports:
    """Keeps what reaches the replicas."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.published: list[Any] = []

    def now_s(self) -> float:
        return 100.0

    def publish_input(self, _name: str, payload: Any) -> bool:
        self.published.append(payload)
        return True


def arrives(process: CloudDataProcess, sequence: int, robot: str = ROBOT) -> None:
    header = envelope.encode(Envelope(Token(robot, 3, CLOUD), sequence, 99_990_000))
    process.arrived("in/scan", header, (robot, sequence))


def serving(robot: str = ROBOT) -> tuple[Ports, CloudDataProcess]:
    ports = Ports()
    process = CloudDataProcess(DataPlan((InputPlan("scan"),), ()), ports)  # type: ignore[arg-type]
    serve(process, robot)
    return ports, process


def serve(process: CloudDataProcess, robot: str) -> None:
    process.handle(Egress(CLOUD, robot, SetEgress(None, 0.0)))


@given(st.lists(st.integers(1, 12), max_size=40))
def test_inputs_reach_the_replicas_once_and_in_order_however_they_arrive(sequences: list[int]) -> None:
    ports, process = serving()
    for sequence in sequences:
        arrives(process, sequence)
    passed = [sequence for _, sequence in ports.published]
    assert passed == sorted(set(passed))
    assert passed[-1:] == ([max(sequences)] if sequences else [])
    assert process.counters["scan.reordered"] == len(sequences) - len(passed)


def test_a_robot_that_was_started_again_begins_anew() -> None:
    ports, process = serving()
    arrives(process, 900)
    serve(process, "3" * 32)
    arrives(process, 5, "3" * 32)
    assert ports.published == [(ROBOT, 900), ("3" * 32, 5)]
