"""Snapshots between two data processes: the holder's reach the standby, nobody else's anybody."""

from __future__ import annotations

import contextlib
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import pytest

from robot_offload_core.data.cloud import CloudDataProcess
from robot_offload_core.data.parameter_values import encode as encode_parameters
from robot_offload_core.data.probe import Probe, decode, encode
from robot_offload_core.data.process import DataPlan
from robot_offload_core.data.robot import RobotDataProcess
from robot_offload_core.data.states import CHANNEL, READ_S, SNAPSHOT_RESEND_S, CloudStates, RobotStates, StateProcess
from robot_offload_core.fence.token import Site, Token
from robot_offload_core.words.declared import ParameterState, SnapshotState, StateSpec, TopicState
from robot_offload_core.words.events import SetEgress
from robot_offload_core.words.holding import Holding
from robot_offload_core.words.messages import DataStatus, Egress, Heard, Orders
from robot_offload_state.packing import pack
from tests.unit.core.builders import CLOUD, ROBOT, STRANGER

NAME = "slam_1"
STATES = {NAME: SnapshotState("slam", max_age_s=0.5, max_size=64)}


def message(data: bytes) -> bytes:
    packed = pack(1, data)
    cdr = b"\x00\x01\x00\x00" + struct.pack("<3I", 0, 0, len(packed)) + packed
    return cdr + bytes(-len(cdr) % 4)


@dataclass
class Ports:
    """Of a data process and of the exchange; what crosses waits in `crossed`."""

    time_s: float = 100.0
    crossed: list[tuple[str, bytes, bytes]] = field(default_factory=list)
    restored: list[bytes] = field(default_factory=list)
    holding: Holding = field(default_factory=lambda: Holding(Site.ROBOT, 1, Token(ROBOT, 3, "")))
    restored_while: list[tuple[bytes, bool]] = field(default_factory=list)
    refused: str = ""
    listens: bool = True
    reached: bool = True
    statuses: list[DataStatus] = field(default_factory=list)
    lock: Any = field(default_factory=contextlib.nullcontext)

    def now_s(self) -> float:
        return self.time_s

    def cross(self, channel: str, header: bytes, payload: Any) -> bool:
        self.crossed.append((channel, header, payload))
        return True

    def restore(self, name: str, payload: bytes) -> bool:
        assert name == NAME
        if self.listens:
            self.restored.append(payload)
        return self.listens

    def has(self, name: str) -> bool:
        assert name == NAME
        return self.reached

    def set_parameters(self, name: str, payload: bytes, active: bool) -> str | None:
        assert name == NAME
        if self.listens and (payload, active) not in self.restored_while:
            self.restored_while.append((payload, active))
        return self.refused if self.listens else None

    def holder(self) -> Holding:
        return self.holding

    def system_s(self) -> float:
        return 1.7e9 + self.time_s

    def types(self) -> dict[str, str]:
        return {}

    def link_status(self) -> tuple[bool, str]:
        return True, "quic"

    def send(self, to: str, message: Any) -> bool:
        assert to == "control"
        self.statuses.append(message)
        return True

    renew = send

    def __getattr__(self, name: str) -> Any:
        raise AssertionError(f"{name} is not for the exchange of state")


class Pair:
    """Both sides; `deliver` carries what has crossed."""

    def __init__(self, states: Mapping[str, StateSpec] = STATES) -> None:
        self.ports = {Site.ROBOT: Ports(), Site.CLOUD: Ports()}
        robot, cloud = self.ports.values()
        self.robot_data = RobotDataProcess(DataPlan((), ()), robot)
        self.cloud_data = CloudDataProcess(DataPlan((), ()), cloud)  # type: ignore[arg-type]
        self.robot = RobotStates(states, robot, self.robot_data)
        self.cloud = CloudStates(states, cloud, self.cloud_data)
        self.robot_holds(3)

    def _meet(self, epoch: int) -> None:
        self.robot_data.handle(Orders(ROBOT, epoch))
        now_s = self.ports[Site.ROBOT].time_s
        for data, other in ((self.robot_data, CLOUD), (self.cloud_data, ROBOT)):
            data.handle(Heard(other, round((now_s - 0.02) * 1e6), now_s))

    def robot_holds(self, epoch: int, stay: int = 1) -> None:
        self._meet(epoch)
        self.ports[Site.ROBOT].holding = Holding(Site.ROBOT, stay, Token(ROBOT, epoch, ""))
        self.cloud_data.handle(Egress(CLOUD, ROBOT, SetEgress(None, 0.0)))

    def cloud_holds(self, epoch: int, stay: int = 2) -> None:
        self._meet(epoch)
        token = Token(ROBOT, epoch, CLOUD)
        self.ports[Site.ROBOT].holding = Holding(Site.CLOUD, stay, token)
        self.cloud_data.handle(Egress(CLOUD, ROBOT, SetEgress(token, self.ports[Site.CLOUD].time_s + 0.3, True)))

    def deliver(self) -> None:
        for sender, receiver in ((Site.ROBOT, self.cloud), (Site.CLOUD, self.robot)):
            crossed, self.ports[sender].crossed = self.ports[sender].crossed, []
            for channel, header, payload in crossed:
                receiver.arrived(channel.removeprefix(CHANNEL), header, payload)

    def later(self, by_s: float) -> None:
        for ports in self.ports.values():
            ports.time_s += by_s

    def restored(self, site: Site) -> list[bytes]:
        return self.ports[site].restored


@pytest.fixture
def pair() -> Pair:
    return Pair()


def stale(process: StateProcess) -> bool:
    process.turn()
    return any(reason == "StateStale" for reason, _ in process.data.problems.values())


def test_a_snapshot_that_waited_is_no_younger_for_that(pair: Pair) -> None:
    system_s = pair.ports[Site.ROBOT].system_s
    pair.robot.published(NAME, message(b"one"), system_s() - 0.001)
    pair.later(0.1)
    pair.robot.data.woke()
    pair.robot.published(NAME, message(b"two"), system_s() - 0.101)
    pair.deliver()
    assert pair.cloud.standing[NAME].age_s > 0.1


def test_a_snapshot_that_is_sent_again_to_another_cloud_has_no_age_by_the_clock_of_the_one_before(pair: Pair) -> None:
    pair.robot_data.handle(Heard("9" * 32, round(40_000 * 1e6), pair.ports[Site.ROBOT].time_s))
    pair.robot.published(NAME, message(b"one"))
    pair.deliver()
    pair.robot_holds(3)
    pair.later(1.1)
    pair.robot.turn()
    pair.deliver()
    assert pair.cloud.standing[NAME].age_s == float("inf"), "nobody can say"


def test_a_snapshot_that_may_have_waited_through_a_pause_is_as_old_as_that(pair: Pair) -> None:
    pair.later(1.0)
    pair.robot_holds(3)
    pair.robot.published(NAME, message(b"one"))
    pair.deliver()
    assert pair.cloud.standing[NAME].age_s > 1.0


def test_what_the_holder_says_reaches_the_standby_on_either_side(pair: Pair) -> None:
    pair.robot.published(NAME, message(b"one"))
    pair.deliver()
    pair.cloud_holds(4)
    pair.cloud.published(NAME, message(b"two"))
    pair.deliver()
    assert (pair.restored(Site.CLOUD), pair.restored(Site.ROBOT)) == ([message(b"one")], [message(b"two")])


def test_what_a_standby_says_reaches_nobody(pair: Pair) -> None:
    pair.cloud.published(NAME, message(b"hot"))
    pair.cloud_holds(4)
    pair.robot.published(NAME, message(b"hot"))
    pair.later(SNAPSHOT_RESEND_S + 0.1)
    pair.cloud_holds(4)
    pair.robot.turn()
    pair.cloud.turn()
    pair.deliver()
    assert pair.restored(Site.CLOUD) == pair.restored(Site.ROBOT) == []


def test_what_was_said_in_an_earlier_stay_is_never_sent_again(pair: Pair) -> None:
    pair.robot.published(NAME, message(b"old"))
    pair.deliver()
    pair.cloud_holds(4)
    pair.cloud.published(NAME, message(b"new"))
    pair.deliver()
    pair.robot_holds(5, stay=3)
    pair.later(SNAPSHOT_RESEND_S + 0.1)
    pair.robot.turn()
    pair.deliver()
    assert pair.restored(Site.CLOUD) == [message(b"old")]


def test_a_standby_that_comes_late_gets_what_was_said_before(pair: Pair) -> None:
    pair.robot.published(NAME, message(b"one"))
    pair.ports[Site.ROBOT].crossed.clear()  # nobody was there
    pair.later(SNAPSHOT_RESEND_S + 0.1)
    pair.robot.turn()
    pair.deliver()
    assert pair.restored(Site.CLOUD) == [message(b"one")]
    assert pair.cloud.standing[NAME].aged_s(pair.ports[Site.CLOUD].time_s) >= SNAPSHOT_RESEND_S + 0.1


def test_reordered_doubled_and_foreign_snapshots_are_not_restored(pair: Pair) -> None:
    for data in (b"one", b"two"):
        pair.robot.published(NAME, message(data))
    crossed = pair.ports[Site.ROBOT].crossed
    crossed[:] = [crossed[1], crossed[0], crossed[1], (crossed[0][0], b"garbage", b""), ("state/x", *crossed[1][1:])]
    pair.deliver()
    assert pair.restored(Site.CLOUD) == [message(b"two")]
    pair.cloud_data.handle(replace(pair.cloud_data.egress, robot=STRANGER))
    pair.robot.published(NAME, message(b"three"))
    pair.deliver()
    assert pair.restored(Site.CLOUD) == [message(b"two")]


def test_a_snapshot_of_a_cloud_that_no_longer_holds_is_not_restored(pair: Pair) -> None:
    pair.cloud_holds(4)
    pair.cloud.published(NAME, message(b"late"))
    pair.robot_holds(5, stay=3)
    pair.deliver()
    assert pair.restored(Site.ROBOT) == []


@pytest.mark.parametrize("payload", [b"", b"pickle", message(b"x" * 65), message(b"torn")[:-4]])
def test_what_is_no_whole_snapshot_is_refused_with_a_reason_and_the_node_goes_on(pair: Pair, payload: bytes) -> None:
    pair.robot.published(NAME, payload)
    assert pair.ports[Site.ROBOT].crossed == []
    [(reason, words)] = pair.robot_data.problems.values()
    assert (reason, words.startswith("A snapshot of slam is")) == ("SnapshotRefused", True)
    pair.robot.published(NAME, message(b"good"))
    assert not pair.robot_data.problems


def test_a_standby_says_when_what_it_knows_is_old(pair: Pair) -> None:
    assert stale(pair.cloud)
    pair.robot.published(NAME, message(b"one"))
    pair.deliver()
    assert not stale(pair.cloud)
    pair.later(0.49)
    assert stale(pair.cloud)
    assert not stale(pair.robot)  # it holds


TOPICS = {NAME: TopicState("amcl", "/amcl_pose", "/initialpose")}


def robot_wakes(pair: Pair, epoch: int, *active: str, preparing: int = 0) -> None:
    pair.robot_data.handle(Orders(ROBOT, epoch, preparing=preparing, active=active))
    pair.robot.turn()


def test_a_topics_message_is_given_each_time_the_node_has_become_active_and_listens() -> None:
    pair = Pair(TOPICS)
    pair.cloud_holds(4)
    pair.cloud.published(NAME, b"pose 1")
    pair.deliver()
    robot_wakes(pair, 4)
    assert not pair.restored(Site.ROBOT), "the node sleeps"
    pair.ports[Site.ROBOT].listens = False
    robot_wakes(pair, 4, "amcl")
    pair.ports[Site.ROBOT].listens = True
    robot_wakes(pair, 4, "amcl")
    robot_wakes(pair, 4, "amcl")
    assert pair.restored(Site.ROBOT) == [b"pose 1"]
    robot_wakes(pair, 4)
    pair.cloud.published(NAME, b"pose 2")
    pair.deliver()
    robot_wakes(pair, 4, "amcl")
    assert pair.restored(Site.ROBOT) == [b"pose 1", b"pose 2"]


def test_after_a_loss_the_robots_node_gets_the_newest_message_of_the_cloud() -> None:
    """Also when the node publishes something of its own before it has been given that."""
    pair = Pair(TOPICS)
    pair.cloud_holds(4)
    pair.cloud.published(NAME, b"pose")
    pair.deliver()
    pair.robot_holds(5, stay=3)
    pair.robot.published(NAME, b"stale")
    robot_wakes(pair, 5, "amcl")
    assert pair.restored(Site.ROBOT) == [b"pose"]
    pair.robot.published(NAME, b"own")
    robot_wakes(pair, 5)
    robot_wakes(pair, 5, "amcl")
    assert pair.restored(Site.ROBOT) == [b"pose"], "its own is newer now"


def test_a_side_that_gets_ready_lacks_a_message_until_its_node_has_it() -> None:
    pair = Pair(TOPICS)
    pair.cloud_holds(4)
    robot_wakes(pair, 4)
    assert pair.robot_data.lacks == {}, "nothing was ever said"
    pair.cloud.published(NAME, b"pose")
    pair.deliver()
    robot_wakes(pair, 4)
    assert "/initialpose" in pair.robot_data.lacks[NAME]
    robot_wakes(pair, 4, "amcl")
    assert pair.robot_data.lacks == {}


def test_a_side_that_gets_ready_lacks_a_snapshot_that_is_too_old_and_its_age_is_counted_at_the_change() -> None:
    pair = Pair()
    pair.cloud_holds(4)
    pair.robot.turn()
    assert NAME in pair.robot_data.lacks
    pair.cloud.published(NAME, message(b"one"))
    pair.deliver()
    pair.robot.turn()
    assert pair.robot_data.lacks == {}
    pair.later(0.6)
    pair.robot.turn()
    assert "500 ms" in pair.robot_data.lacks[NAME]
    pair.robot_holds(5, stay=3)
    pair.robot.turn()
    assert pair.robot_data.lacks == {}
    assert 600 <= pair.robot_data.counters[f"state {NAME}.age_at_change_ms"] <= 650


def test_a_side_lacks_a_snapshot_until_it_has_reached_the_node_but_does_not_wait_long_for_that() -> None:
    pair = Pair()
    pair.cloud_holds(4)

    def lacks_after(by_s: float) -> bool:
        pair.later(by_s)
        pair.cloud_holds(4)
        pair.cloud.published(NAME, message(b"new"))
        pair.deliver()
        pair.robot.turn()
        return bool(pair.robot_data.lacks)

    pair.ports[Site.ROBOT].reached = False
    assert lacks_after(0.1)
    assert "not reached" in pair.robot_data.lacks[NAME]
    assert lacks_after(READ_S - 0.01)
    assert not lacks_after(0.1), "it may listen only when it is Active"
    pair.ports[Site.ROBOT].reached = True
    assert not lacks_after(0.1)
    pair.ports[Site.ROBOT].reached = False
    assert not lacks_after(0.1), "what reached it is young"
    assert lacks_after(0.5)


def test_the_robots_control_hears_what_each_side_lacks_for_which_preparation() -> None:
    pair = Pair()
    token = Token(ROBOT, 7, CLOUD)
    pair.cloud_data.handle(Egress(CLOUD, ROBOT, SetEgress(token, 200.0)))
    pair.cloud.turn()
    probe = pair.cloud_data.make_probe()
    assert (probe.preparing, list(probe.lacks)) == (7, [NAME])
    decoded = decode(encode(probe))
    assert isinstance(decoded, Probe)
    assert (decoded.preparing, decoded.lacks) == (7, probe.lacks)


def test_a_side_lacks_a_snapshot_from_its_first_word_on_and_before_anybody_was_heard() -> None:
    data = CloudDataProcess(DataPlan((), ()), Ports())  # type: ignore[arg-type]
    CloudStates(STATES, Ports(), data)
    assert list(data.make_probe().lacks) == [NAME]


def test_control_hears_which_state_a_node_is_to_have_before_it_is_active() -> None:
    both = {NAME: STATES[NAME], "amcl_1": PARAMETERS[NAME]}
    pair = Pair(both)
    pair.robot_data.probe = Probe(CLOUD, lacks={NAME: "no snapshot", "amcl_1": "no parameters"})
    pair.robot_data.report(pair.ports[Site.ROBOT].time_s, detailed=False)
    robot, cloud = pair.ports[Site.ROBOT].statuses[-1].states
    assert (robot.site, robot.lacking) == (Site.ROBOT, ())
    assert (cloud.lacking, cloud.before_active) == (("no snapshot", "no parameters"), ("no snapshot",))


PARAMETERS = {NAME: ParameterState("amcl")}
SLOW, FAST = (encode_parameters({"amcl": {"speed": (3, value)}}) for value in (0.2, 0.6))


def test_parameters_are_set_at_once_and_again_after_each_activation() -> None:
    pair = Pair(PARAMETERS)
    pair.cloud_holds(4)
    pair.cloud.published(NAME, FAST)
    pair.deliver()
    for active in ((), ("amcl",)):
        robot_wakes(pair, 4, *active)
    assert pair.ports[Site.ROBOT].restored_while == [(FAST, False), (FAST, True)]
    assert pair.robot_data.lacks == {}


def test_a_side_lacks_parameters_until_they_are_set_in_its_activation_and_names_what_was_refused() -> None:
    pair = Pair(PARAMETERS)
    pair.cloud_holds(4)
    robot_wakes(pair, 4)
    assert pair.robot_data.lacks == {}, "nothing was ever said"
    pair.cloud.published(NAME, FAST)
    pair.deliver()
    robot_wakes(pair, 4)
    assert "parameters" in pair.robot_data.lacks[NAME]
    pair.ports[Site.ROBOT].refused = "the replica did not take amcl.speed (read-only)"
    robot_wakes(pair, 4, "amcl")
    assert pair.robot_data.lacks == {NAME: "the replica did not take amcl.speed (read-only)"}
    assert [reason for reason, _ in pair.robot_data.problems.values()] == ["ParameterRefused"]
    pair.ports[Site.ROBOT].refused = ""
    robot_wakes(pair, 4, "amcl")
    assert (pair.robot_data.lacks, pair.robot_data.problems) == ({}, {})


def test_after_a_loss_the_parameters_of_the_cloud_come_before_the_robots_own() -> None:
    pair = Pair(PARAMETERS)
    pair.cloud_holds(4)
    pair.cloud.published(NAME, FAST)
    pair.deliver()
    robot_wakes(pair, 4)
    pair.ports[Site.ROBOT].listens = False
    pair.robot_holds(5, stay=3)
    robot_wakes(pair, 5, "amcl")
    pair.robot.published(NAME, SLOW)
    assert not pair.ports[Site.ROBOT].crossed, "what its node was started with is older than what the cloud had"
    pair.ports[Site.ROBOT].listens = True
    robot_wakes(pair, 5, "amcl")
    pair.robot.published(NAME, FAST)
    assert len(pair.ports[Site.ROBOT].crossed) == 1
    pair.robot.published(NAME, FAST)
    assert len(pair.ports[Site.ROBOT].crossed) == 1, "nothing was set"


@pytest.mark.parametrize("payload", [b"", b"{", b"[]", b'{"amcl":{"speed":[3,"x"]}}'])
def test_what_are_no_parameters_is_never_set(payload: bytes) -> None:
    pair = Pair(PARAMETERS)
    pair.robot.published(NAME, SLOW)
    [(channel, header, _)] = pair.ports[Site.ROBOT].crossed
    pair.ports[Site.ROBOT].crossed = [(channel, header, payload)]
    pair.deliver()
    pair.cloud.turn()
    assert (pair.ports[Site.CLOUD].restored_while, pair.cloud_data.counters[f"state {NAME}.refused"]) == ([], 1)
