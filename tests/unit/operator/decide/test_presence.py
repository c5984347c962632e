"""The robot is there while its Lease moves, by our own clock."""

from __future__ import annotations

from datetime import timedelta
from typing import Any

from robot_offload.decide.presence import Presence, look, presence, wanted
from tests.unit.operator.decide.worlds import NOW, lease, offload

CONNECTED = {"connected": True, "since": "2026-11-21T11:00:00Z"}
GONE = {"connected": False, "since": "2026-11-21T11:00:00Z", "lastSeen": "2026-11-21T11:00:00Z"}


def seen(*leases: tuple[float, dict[str, Any] | None], now_s: float, before: dict[str, Any]) -> Presence:
    """The presence after looking at these Leases at these times."""
    sighting = None
    for at_s, found in leases:
        sighting = look(sighting, found, at_s)
    assert sighting is not None
    return presence(leases[-1][1], sighting, before, now_s, NOW)


def test_a_lease_that_moves_is_a_connected_robot() -> None:
    robot = seen((0, lease(renewed="1")), (10, lease(renewed="2")), now_s=10, before={})
    assert (robot.connected, robot.verdict.reason) == (True, "Connected")
    assert robot.recheck_s == 30
    assert robot.since == NOW


def test_a_lease_that_stopped_moving_ends_by_our_clock_whatever_its_own_times_say() -> None:
    moved = [(0.0, lease(renewed="1")), (10.0, lease(renewed="2999-01-01T00:00:00Z"))]
    assert seen(*moved, now_s=39, before=CONNECTED).connected
    robot = seen(*moved, now_s=40, before=CONNECTED)
    assert (robot.connected, robot.verdict.reason) == (False, "LeaseExpired")
    assert (robot.since, robot.last_seen) == (NOW, NOW)


def test_a_lease_without_holder_is_a_robot_that_left() -> None:
    robot = seen((0, lease()), (1, lease(holder=None)), now_s=1, before=CONNECTED)
    assert (robot.connected, robot.verdict.reason, robot.recheck_s) == (False, "Disconnected", None)


def test_no_lease_is_a_robot_that_never_came() -> None:
    robot = seen((0, None), now_s=0, before={})
    assert (robot.connected, robot.verdict.reason) == (False, "NeverConnected")


def test_after_our_own_start_an_old_lease_neither_connects_nor_disconnects() -> None:
    """What the status said holds until the Lease moves or runs out."""
    gone = seen((100, lease()), now_s=100, before=GONE)
    assert not gone.connected
    assert gone.since.hour == 11
    there = seen((100, lease()), now_s=100, before=CONNECTED)
    assert there.connected
    assert there.since.hour == 11
    assert seen((100, lease(renewed="1")), (101, lease(renewed="2")), now_s=101, before=GONE).connected
    assert not seen((100, lease()), now_s=130, before=CONNECTED).connected


def test_nodes_keep_their_pods_for_the_idle_time_and_then_lose_them() -> None:
    spec = offload(scale={"idleTimeout": "10m"}).spec
    robot = seen((0, lease(holder=None)), now_s=0, before={**GONE, "since": "2026-11-21T11:55:00Z"})
    soon = wanted(spec, robot, NOW)
    assert (soon.nodes, soon.recheck_s) == (True, 300)
    late = wanted(spec, robot, NOW + timedelta(minutes=5))
    assert (late.nodes, late.verdict.reason) == (False, "RobotGone")


def test_an_idle_time_of_zero_never_takes_the_pods() -> None:
    robot = seen((0, None), now_s=0, before=GONE)
    assert wanted(offload(scale={"idleTimeout": "0s"}).spec, robot, NOW + timedelta(days=9)).nodes


def test_replicas_zero_beats_a_connected_robot() -> None:
    robot = seen((0, lease(renewed="1")), (1, lease(renewed="2")), now_s=1, before={})
    off = wanted(offload(replicas=0).spec, robot, NOW)
    assert (off.nodes, off.verdict.reason) == (False, "SwitchedOff")
