"""The robot's control process: what it sends how often, and which problems of others become vetoes."""

from __future__ import annotations

from typing import Any

import pytest

from robot_offload_core.control.nodes import managed_nodes
from robot_offload_core.control.robot import requests
from robot_offload_core.control.robot.availability import Available
from robot_offload_core.control.robot.process import LEVELS_PER_LEASE, RobotControlProcess, RobotPlan
from robot_offload_core.fence.token import Site
from robot_offload_core.words.beats import Beat
from robot_offload_core.words.decided import Decided, Phase
from robot_offload_core.words.gates import GateReport
from robot_offload_core.words.messages import CollectorStatus, SetGate
from robot_offload_core.words.replace import replace
from robot_offload_core.words.settings import NodeSpec, OutputSpec
from tests.unit.core.builders import CLOUD, NOW_S, ROBOT, SETTINGS, STRANGER, us


class Ports:
    """A shell that writes down what is sent."""

    def __init__(self) -> None:
        self.time_s = NOW_S
        self.sent: list[tuple[str, object]] = []
        self.statements: tuple[Available, ...] = ()

    def now_s(self) -> float:
        return self.time_s

    def send(self, to: str, message: object) -> bool:
        self.sent.append((to, message))
        return True

    def renew(self, to: str, message: object) -> bool:
        return self.send(to, message)

    def carry_out(self, command: managed_nodes.Command) -> None: ...

    def answer(self, key: int, accepted: bool, message: str) -> None: ...

    def network_status(self, sustained: int) -> None: ...

    def decided(self, decided: Decided) -> None: ...

    def effects_changed(self) -> None: ...

    def available(self, statements: tuple[Available, ...]) -> None:
        self.statements = statements


def control(**plan: Any) -> tuple[RobotControlProcess, Ports]:
    ports = Ports()
    nodes = (NodeSpec("controller", core=True),)
    return RobotControlProcess(RobotPlan(SETTINGS, SETTINGS, (), nodes, **plan), ports, ROBOT, us(NOW_S)), ports


def test_a_gate_that_says_the_same_goes_out_five_times_in_a_lease() -> None:
    process, ports = control()
    for _ in range(200):
        ports.time_s += 0.010
        process.turn()
    gates = [message for to, message in ports.sent if to == "collector" and isinstance(message, SetGate)]
    expected = 200 * 0.010 / SETTINGS.lease_s * LEVELS_PER_LEASE
    assert 0.7 * expected <= len(gates) <= 1.2 * expected
    assert all(gate.gate.said_s is not None for gate in gates)


def test_the_guardian_knows_of_which_nodes_on_the_robot_the_collector_hears_the_outputs() -> None:
    """So a node in a long callback, which answers nobody, is not dead: `test_guardian.py`."""
    outputs = (OutputSpec("command", 0.15), OutputSpec("plan", 0.0))
    process, _ = control(outputs=outputs, publishers=("controller", "planner"))
    for flowing, names in (((0, 1), ("controller",)), ((), ())):
        process.handle(CollectorStatus(GateReport(None, False, True, False, robot_flowing=flowing)))
        assert process.guardian.flowing == names


def test_a_second_publisher_is_a_veto_and_with_strict_stops_the_driver() -> None:
    problem = [("SecondPublisher", "/cmd_vel has another publisher: teleop"), ("NoPublisher", "/scan")]
    for strict in (False, True):
        process, _ = control(strict=strict)
        process.veto("collector", problem)
        (vetoed,) = process.robot.vetoes
        assert [(v.reason.value, v.stops) for v in vetoed.vetoes] == [("SecondPublisher", strict)]
        process.veto("collector", [])
        assert process.robot.vetoes == ()


def test_two_replicas_in_the_cloud_forbid_it_and_two_on_the_robot_stop_only_the_robot_that_acts() -> None:
    problem = [("TwoReplicas", "/offload/command is published by 2 processes (/walker, /walker)")]
    for source, forbids in (("cloud", True), ("collector", False)):
        process, _ = control(strict=True)
        process.veto(source, problem)
        assert bool(list(requests.reported(process.robot))) is forbids
        assert requests.stop(process.robot) == problem[0][1]
        in_cloud = replace(process.robot, phase=Phase.CLOUD)
        assert bool(requests.stop(in_cloud)) is forbids


def test_an_undeclared_publisher_is_a_veto_only_when_that_is_wanted() -> None:
    for strict in (False, True):
        process, _ = control(strict=strict)
        process.veto("nodes", [("UndeclaredPublisher", "controller publishes /debug")])
        assert bool(process.robot.vetoes) is strict


def test_parameters_that_differ_stop_no_driver_and_are_degraded_in_a_stay() -> None:
    process, _ = control(strict=True)
    process.veto("parameters", [("ReplicaParametersDiffer", "Parameters differ: controller (speed)")])
    (vetoed,) = process.robot.vetoes
    assert not any(veto.stops for veto in vetoed.vetoes)
    assert process.degraded() is None
    process.robot = replace(process.robot, phase=Phase.CLOUD)
    assert process.degraded() == ("Degraded", "ReplicaParametersDiffer: Parameters differ: controller (speed)")


def beat_of(cloud: str, sequence: int, now_s: float) -> Beat:
    """A bare beat, which says nothing but that its sender lives."""
    return Beat("uid", Site.CLOUD, cloud, sequence, us(now_s), 0, 1000, None, None)


def ticks_of(process: RobotControlProcess, ports: Ports, cloud: str, beats: int) -> int:
    """Beats of that sender come with each turn; returns how many turns made a Tick."""
    ticks = 0
    for sequence in range(beats):
        ports.time_s += 0.020
        process.arrived(beat_of(cloud, sequence, ports.time_s), ports.time_s, 0)
        before = process.robot.stalls.read_s
        process.turn()
        ticks += process.robot.stalls.read_s != before
        assert process.robot.judged_s(ports.time_s) >= ports.time_s - 0.045
    return ticks


def test_a_beat_of_our_cloud_judges_like_a_tick_and_takes_the_place_of_two_in_three() -> None:
    process, ports = control()
    assert 30 <= ticks_of(process, ports, CLOUD, 90) <= 31
    silent = process.robot.link.heard_s
    assert ticks_of(process, ports, STRANGER, 4) == 4, "a beat of a stranger takes the place of none"
    assert process.robot.link.heard_s == silent
    for _ in range(10):
        ports.time_s += 0.020
        process.turn()
        assert process.robot.stalls.read_s == ports.time_s


@pytest.mark.parametrize("beats", [30, 31, 32])
def test_turns_that_come_late_after_the_last_beat_are_no_stall_of_ours(beats: int) -> None:
    """A turn may be 30 ms late: its Tick is not left out for a beat that came long before it."""
    process, ports = control()
    ticks_of(process, ports, CLOUD, beats)
    process.arrived(beat_of(CLOUD, beats, ports.time_s), ports.time_s, 0)
    for wait_s in (0.029, 0.030, 0.030):  # the beats have ceased
        ports.time_s += wait_s
        process.turn()
    assert process.robot.stalls.last_s is None
