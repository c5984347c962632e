"""What no step may break: a machine in such a state ends its process instead of acting on it."""

from __future__ import annotations

from typing import Any

import pytest

from robot_offload_core.collector import gate
from robot_offload_core.control.cloud import lease
from robot_offload_core.control.cloud.lease import Cloud, RobotBeat
from robot_offload_core.control.nodes import guardians
from robot_offload_core.control.nodes.guardians import Guardian
from robot_offload_core.control.robot import switcher
from robot_offload_core.control.robot.placement import Preparation, Robot
from robot_offload_core.fence.gate import Charge
from robot_offload_core.fence.lease import Lease
from robot_offload_core.fence.token import Site, Token
from robot_offload_core.words.beats import Beat, Echo, Permission
from robot_offload_core.words.checks import InvariantError
from robot_offload_core.words.decided import Phase
from robot_offload_core.words.events import Tick
from robot_offload_core.words.gates import Gate
from robot_offload_core.words.replace import replace
from robot_offload_core.words.settings import NodeSpec, OutputSpec
from tests.unit.core.builders import CLOUD, NOW_S, ROBOT, SETTINGS, robot_in


class Unknown:
    """No event of any machine."""


@pytest.mark.parametrize(
    ("before", "after", "rule"),
    [
        (robot_in(), robot_in(epoch=robot_in().epoch - 1), "the epoch fell"),
        (robot_in(), robot_in(Phase.CLOUD, epoch=robot_in().epoch), "within one epoch"),
        (robot_in(), robot_in(last_epoch=0), "beyond the last"),
        (robot_in(), replace(robot_in(Phase.CLOUD), phase=Phase.TAKEOVER), "name different sides"),
        (robot_in(), replace(robot_in(), preparation=Preparation(0.0)), "while a side gets ready"),
        (robot_in(), robot_in(candidate=9, last_epoch=9), "a candidate exactly while"),
        (robot_in(Phase.TO_CLOUD), replace(robot_in(Phase.TO_CLOUD), preparation=None), "while a side gets ready"),
        (robot_in(), robot_in(Phase.TO_CLOUD, candidate=3), "is not newer"),
        (robot_in(Phase.CLOUD), robot_in(Phase.CLOUD, cloud=""), "by no name"),
    ],
)
def test_the_placement_machine_refuses_a_state(before: Robot, after: Robot, rule: str) -> None:
    with pytest.raises(InvariantError, match=rule) as caught:
        switcher.check(before, after, Tick())
    assert caught.value.event == Tick()


@pytest.mark.parametrize(
    ("change", "rule"),
    [
        ({"epoch": 3}, "the epoch fell"),
        ({"granted": False}, "without a grant"),
        ({"end_s": NOW_S + 1.0}, "longer than a lease"),
        ({"robot": ""}, "of nobody"),
    ],
)
def test_the_lease_refuses_a_state(change: dict[str, Any], rule: str) -> None:
    cloud = Cloud(Lease(CLOUD, ROBOT, epoch=4, granted=True, end_s=NOW_S + 0.1), SETTINGS)
    with pytest.raises(InvariantError, match=rule):
        lease.check(cloud, replace(cloud, lease=replace(cloud.lease, **change)), Tick(), NOW_S)


def test_an_echo_of_a_beat_that_is_still_unsent_grants_nothing() -> None:
    cloud = lease.start(CLOUD, SETTINGS)
    echo = Echo(CLOUD, 7, round((NOW_S + 60.0) * 1e6), 0)
    beat = Beat("uid", Site.ROBOT, ROBOT, 1, 1, 0, 0, echo, Permission(2, True, CLOUD, 250_000))
    cloud, _ = lease.step(cloud, RobotBeat(beat, NOW_S), NOW_S)
    assert cloud.lease.granted
    assert not lease.holds_lease(cloud, NOW_S)


@pytest.mark.parametrize(
    ("change", "rule"),
    [({"nodes": ()}, "lost"), ({"in_charge": True}, "without acting"), ({"inhibit_said": True}, "does not exist")],
)
def test_the_guardian_refuses_a_state(change: dict[str, Any], rule: str) -> None:
    guardian: Guardian = guardians.start([NodeSpec("walker")], 0.25)
    with pytest.raises(InvariantError, match=rule):
        guardians.check(guardian, replace(guardian, **change), Tick())


def test_the_collector_refuses_a_state() -> None:
    state = gate.start((OutputSpec("cmd"),), 0.15, 0.25)
    newer, older = (Charge(Site.ROBOT, Token(ROBOT, epoch, "")) for epoch in (5, 4))
    state = gate.set_gate(state, Gate(1, newer), NOW_S)
    for change, rule in (
        ({"charge": older}, "the epoch fell"),
        ({"charge": None}, "forgotten"),
        ({"next": older}, "not newer"),
        ({"next": Charge(Site.CLOUD, Token(ROBOT, 6, CLOUD)), "fell_back": True}, "fell back"),
    ):
        with pytest.raises(InvariantError, match=rule):
            gate.check(state, replace(state, fence=replace(state.fence, **change)), "test")  # type: ignore[arg-type]


def test_a_gate_that_names_an_older_side_as_next_arms_nobody() -> None:
    state = gate.start((OutputSpec("cmd"),), 0.15, 0.25)
    current = Charge(Site.ROBOT, Token(ROBOT, 5, ""))
    state = gate.set_gate(state, Gate(1, current, Charge(Site.CLOUD, Token(ROBOT, 5, CLOUD))), NOW_S)
    assert state.next is None


@pytest.mark.parametrize(
    "step",
    [
        lambda event: switcher.step(robot_in(), event, NOW_S),
        lambda event: lease.step(lease.start(CLOUD, SETTINGS), event, NOW_S),
        lambda event: guardians.step(guardians.start((), 0.25), event, NOW_S),
    ],
)
def test_an_event_that_nobody_takes_in_is_not_ignored(step: Any) -> None:
    with pytest.raises(TypeError, match="nobody takes in"):
        step(Unknown())
