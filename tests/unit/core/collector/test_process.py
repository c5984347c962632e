"""The collector's process around its machine: types of the two sides, and others in front of the consumers."""

from __future__ import annotations

import json
from typing import Any

import pytest

from robot_offload_core.collector.process import CollectorPlan, CollectorProcess
from robot_offload_core.collector.state import Collector
from robot_offload_core.fence import envelope
from robot_offload_core.fence.envelope import Envelope
from robot_offload_core.fence.gate import Charge
from robot_offload_core.fence.token import Site, Token
from robot_offload_core.words.codec import plain, typed
from robot_offload_core.words.gates import Gate
from robot_offload_core.words.messages import ENVELOPE, PASSED, Carried, CloudTypes, CollectorStatus, SetGate
from robot_offload_core.words.replace import replace
from robot_offload_core.words.settings import OutputSpec
from robot_offload_core.words.topic_kinds import same_type

TWIST = "geometry_msgs/msg/Twist"
STAMPED = "geometry_msgs/msg/TwistStamped"
TOKEN = Token("1" * 32, 4, "2" * 32)


class Ports:
    """Keeps what the process does."""

    def __init__(self) -> None:
        self.type = TWIST
        self.at_s = 100.0
        self.published: list[Any] = []
        self.carried: list[tuple[bytes, int, Any]] = []
        self.statuses: list[CollectorStatus] = []

    def now_s(self) -> float:
        return self.at_s

    def send(self, to: str, message: object) -> bool:
        assert to == "control"
        assert isinstance(message, CollectorStatus)
        self.statuses.append(message)
        return True

    def renew(self, to: str, message: object) -> bool:
        return self.send(to, message)

    def carry(self, to: str, kind: bytes, index: int, header: bytes, payload: Any) -> bool:
        self.carried.append((kind, index, payload))
        return True

    def publish(self, index: int, payload: Any) -> None:
        self.published.append(payload)

    def type_of(self, index: int) -> str:
        return self.type

    def topics_of(self, index: int) -> tuple[str, str]:
        return "/command", "/offload/robot/command"

    def save(self, state: Collector) -> None:
        pass

    def fell_silent(self) -> None:
        pass


def acting_cloud() -> tuple[Ports, CollectorProcess]:
    ports = Ports()
    plan = CollectorPlan((OutputSpec("command", 0.3),), (False,), 0.15, 0.25)
    process = CollectorProcess(plan, ports)
    process.handle(SetGate(Gate(1, Charge(Site.CLOUD, TOKEN))))
    return ports, process


def of_the_cloud(sequence: int = 1) -> Carried:
    return Carried(ENVELOPE, 0, envelope.encode(Envelope(TOKEN, sequence, round(99.99e6))), b"go")


@pytest.mark.parametrize(
    ("ours", "theirs", "counted"),
    [("", TWIST, "NoType"), (TWIST, "", "NoType"), (TWIST, STAMPED, "TypesDiffer")],
)
def test_a_message_of_the_cloud_passes_only_where_both_types_are_known_and_the_same(
    ours: str, theirs: str, counted: str
) -> None:
    ports, process = acting_cloud()
    ports.type = ours
    process.handle(CloudTypes((("command", theirs),)))
    process.handle(of_the_cloud())
    process.report()
    assert ports.published == []
    assert +process.counters == {f"command.cloud.{counted}": 1}
    assert not ports.statuses[-1].report.cloud_flows

    ports.type = TWIST
    process.handle(CloudTypes((("command", TWIST),)))
    process.handle(of_the_cloud(2))
    assert ports.published == [b"go"]


def test_what_was_held_for_a_changeover_reaches_consumers_in_the_cloud_as_well() -> None:
    ports = Ports()
    outputs = (OutputSpec("command", 0.3), OutputSpec("light", 0.3))
    process = CollectorProcess(CollectorPlan(outputs, (True, True), 0.15, 0.25), ports)
    robot = Charge(Site.ROBOT, replace(TOKEN, epoch=5))
    process.handle(SetGate(Gate(1, Charge(Site.CLOUD, TOKEN), robot)))
    process.offer_robot(0, b"held")
    assert (ports.published, ports.carried) == ([], [])
    process.offer_robot(1, b"changes over")
    assert ports.published == [b"held", b"changes over"]
    assert ports.carried == [(PASSED, 0, b"held"), (PASSED, 1, b"changes over")]


def test_control_hears_the_silence_of_the_last_change_and_how_old_the_clouds_messages_are() -> None:
    ports, process = acting_cloud()
    process.handle(CloudTypes((("command", TWIST),)))
    process.handle(of_the_cloud())
    process.detail_due_s = 0.0
    process.report()
    assert ports.statuses[-1].ages_ms == (("command", 10),)
    assert ports.statuses[-1].silence is None
    ports.at_s = 100.05
    process.handle(SetGate(Gate(2, Charge(Site.ROBOT, replace(TOKEN, epoch=5)))))
    ports.at_s = 100.1
    process.offer_robot(0, b"stop")
    ports.at_s = 107.0
    process.detail_due_s = 0.0
    process.report()
    silence = ports.statuses[-1].silence
    assert silence is not None
    assert (silence[0], round(silence[1], 2), silence[2]) == (Site.ROBOT, 100.05, 100.0)
    assert ports.statuses[-1].ages_ms == ()  # what is not new any more is said no more
    assert typed(CollectorStatus, json.loads(json.dumps(plain(ports.statuses[-1])))) == ports.statuses[-1]


def test_types_that_differ_are_a_problem_until_they_agree() -> None:
    ports, process = acting_cloud()
    process.handle(CloudTypes((("command", STAMPED),)))
    process.detail_due_s = 0.0
    process.report()
    assert ports.statuses[-1].problems == (
        ("TypesDiffer", f"Output command is {TWIST} here and {STAMPED} in the cloud"),
    )
    process.handle(CloudTypes((("command", TWIST),)))
    process.detail_due_s = 0.0
    process.report()
    assert ports.statuses[-1].problems == ()


def test_somebody_else_in_front_of_the_consumers_is_a_problem_that_names_both_topics() -> None:
    _, process = acting_cloud()
    sentence = process.rival(0, ["/walker"])
    assert sentence == "/command has another publisher: /walker; remap its output to /offload/robot/command"
    assert list(process.problems.values()) == [("SecondPublisher", sentence)]
    assert process.rival(0, []) == ""
    assert not process.problems


def test_types_are_compared_by_name_and_by_hash_where_both_have_one() -> None:
    assert same_type(TWIST, f"{TWIST} RIHS01_aa")
    assert same_type(f"{TWIST} RIHS01_aa", f"{TWIST} RIHS01_aa")
    assert not same_type(f"{TWIST} RIHS01_aa", f"{TWIST} RIHS01_bb")
    assert not same_type(TWIST, STAMPED)


def test_each_change_of_the_side_that_passes_is_a_stay_of_its_own_also_after_a_restart() -> None:
    """Contract of the handover, section 1: a stay is counted in the collector's memory, epochs are not."""
    ports, collector = acting_cloud()
    first = collector.state.stay
    collector.handle(SetGate(Gate(1, Charge(Site.CLOUD, Token("1" * 32, 5, "2" * 32)))))
    assert collector.state.stay == first  # another epoch of the same side
    robot = Charge(Site.ROBOT, Token("1" * 32, 6, "2" * 32))
    collector.handle(SetGate(Gate(1, robot)))
    assert collector.state.stay == first + 1
    successor = CollectorProcess(collector.plan, ports, (robot, 1, False, collector.state.stay))
    successor.handle(SetGate(Gate(2, Charge(Site.CLOUD, Token("3" * 32, 1, "2" * 32)))))
    assert successor.state.stay == first + 2
