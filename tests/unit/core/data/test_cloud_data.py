"""Inputs on their way to the replicas: each once, in the order in which the robot sent them."""

from __future__ import annotations

import threading
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from robot_offload_core.data import probe
from robot_offload_core.data.cloud import CloudDataProcess
from robot_offload_core.data.probe import Probe
from robot_offload_core.data.process import DataPlan, InputPlan
from robot_offload_core.fence import envelope
from robot_offload_core.fence.envelope import Envelope
from robot_offload_core.fence.token import Token
from robot_offload_core.words.events import SetEgress
from robot_offload_core.words.messages import Egress

ROBOT, CLOUD = "1" * 32, "2" * 32
SCAN, POSE = "sensor_msgs/msg/LaserScan", "geometry_msgs/msg/Pose"


class Ports:
    """Keeps what reaches the replicas."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.published: list[Any] = []
        self.type = SCAN

    def now_s(self) -> float:
        return 100.0

    def input_type(self, _name: str) -> str:
        return self.type

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
    says(process, robot)


def says(process: CloudDataProcess, robot: str = ROBOT, kind: str = SCAN, hashes: dict[str, str] | None = None) -> None:
    """Lets the robot say the type of its input."""
    said = probe.signed(Probe(robot, types={"scan": kind}, hashes=hashes or {}), "")
    process.arrived("probe", b"-", probe.encode(said))


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


def test_bytes_of_another_type_are_not_published_until_the_publisher_has_that_type() -> None:
    ports, process = serving()
    arrives(process, 1)
    says(process, kind=POSE)
    arrives(process, 2)
    assert [sequence for _, sequence in ports.published] == [1]
    assert process.counters["scan.TypesDiffer"] == 1
    ports.type = POSE
    arrives(process, 3)
    assert [sequence for _, sequence in ports.published] == [1, 3]


def test_a_type_of_the_same_name_with_another_hash_is_another_type() -> None:
    ports, process = serving()
    ports.type = f"{SCAN} RIHS01_aa"
    says(process, hashes={"scan": "RIHS01_bb"})
    arrives(process, 1)
    assert not ports.published
    says(process, hashes={"scan": "RIHS01_aa"})
    arrives(process, 2)
    assert len(ports.published) == 1


def test_what_a_robot_said_before_it_was_started_again_is_no_word_on_its_types() -> None:
    ports, process = serving()
    other = "3" * 32
    process.handle(Egress(CLOUD, other, SetEgress(None, 0.0)))
    arrives(process, 1, other)
    assert not ports.published
    says(process, other)
    arrives(process, 2, other)
    assert ports.published == [(other, 2)]
