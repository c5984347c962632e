"""Whether the robot is connected, from its Lease, and what follows for the pods of its nodes.

The Lease's own times come from another host's clock and are never compared with ours. What counts is when we last
saw its `renewTime` change, on our steady clock.
"""

from __future__ import annotations

import datetime
from dataclasses import dataclass
from typing import Any, Final

from robot_offload.api.v1alpha1 import RobotOffloadSpec
from robot_offload.decide.verdicts import Verdict, no, yes
from robot_offload.kube.port import Manifest

DEFAULT_DURATION_S: Final = 30.0
"""Of a Lease without a duration: three of the reporter's periods."""


@dataclass(frozen=True, slots=True)
class Sighting:
    """The last observed change of the Lease.

    Attributes:
        renewed: its holder and `renewTime`, as text.
        changed_s: when that changed, on our steady clock.
        first: whether only the Lease itself was seen so far, no change: it may be a dead robot's.
    """

    renewed: str
    changed_s: float
    first: bool


@dataclass(frozen=True, slots=True)
class Presence:
    """Whether the robot is connected.

    Attributes:
        connected: whether it is.
        since: when that last changed, by our wall clock; for people and for idle times of minutes.
        last_seen: when it was last connected, if it is not now; None: never.
        verdict: the same for the condition Connected.
        recheck_s: seconds after which the answer may change without any event; None: never.
    """

    connected: bool
    since: datetime.datetime
    last_seen: datetime.datetime | None
    verdict: Verdict
    recheck_s: float | None


def look(before: Sighting | None, lease: Manifest | None, now_s: float) -> Sighting:
    """Return the sighting after reading the Lease."""
    spec = (lease or {}).get("spec") or {}
    renewed = f"{spec.get('holderIdentity') or ''}@{spec.get('renewTime') or ''}"
    if before is None:
        return Sighting(renewed, now_s, first=True)
    return before if before.renewed == renewed else Sighting(renewed, now_s, first=False)


def duration_s(lease: Manifest | None) -> float:
    """Return for how many seconds a Lease is valid after a renewal."""
    return float(((lease or {}).get("spec") or {}).get("leaseDurationSeconds") or DEFAULT_DURATION_S)


def meaning(lease: Manifest) -> tuple[Any, ...]:
    """Return the content of a Lease apart from its renewal: a change needs a pass."""
    metadata = lease["metadata"]
    return (
        (lease.get("spec") or {}).get("holderIdentity"),
        metadata.get("annotations"),
        metadata.get("labels"),
        metadata.get("ownerReferences"),
    )


def presence(
    lease: Manifest | None,
    sighting: Sighting,
    before: dict[str, Any],
    now_s: float,
    now: datetime.datetime,
) -> Presence:
    """Return whether the robot is connected.

    Args:
        lease: the robot's Lease.
        sighting: from `look`, of the same Lease.
        before: `status.robot` as it was last written; empty: never.
        now_s: our steady clock.
        now: our wall clock.
    """
    connected, recheck_s = _connected(lease, sighting, before, now_s)
    was = before.get("connected")
    since = _time(before.get("since")) if was is connected else None
    last_seen = None
    if not connected:
        last_seen = now if was else _time(before.get("lastSeen"))
    return Presence(connected, since or now, last_seen, _verdict(lease, connected, last_seen), recheck_s)


def _connected(
    lease: Manifest | None, sighting: Sighting, before: dict[str, Any], now_s: float
) -> tuple[bool, float | None]:
    spec = (lease or {}).get("spec") or {}
    if not spec.get("holderIdentity"):
        return False, None
    left_s = sighting.changed_s + duration_s(lease) - now_s
    if left_s <= 0:
        return False, None
    # After our start an old Lease looks like a fresh one: our last answer holds until it moves or expires.
    connected = bool(before.get("connected", True)) if sighting.first else True
    return connected, left_s


def _verdict(lease: Manifest | None, connected: bool, last_seen: datetime.datetime | None) -> Verdict:
    if connected:
        holder = ((lease or {}).get("spec") or {}).get("holderIdentity")
        return yes("Connected", f"The agent of robot {holder} is connected")
    if last_seen is None:
        return no("NeverConnected", "No robot has connected yet; write its files with `kubectl offload bundle`")
    if ((lease or {}).get("spec") or {}).get("holderIdentity"):
        return no("LeaseExpired", "The cloud agent has not reported for a while; look at its pod")
    return no("Disconnected", "The robot's agent is not connected; it acts alone until it is back")


@dataclass(frozen=True, slots=True)
class Wanted:
    """The wanted pods of nodes.

    Attributes:
        nodes: whether any are wanted. Rendering decides about Cold ones, which also need a connected robot.
        verdict: why.
        recheck_s: seconds after which that may change without any event; None: never.
    """

    nodes: bool
    verdict: Verdict
    recheck_s: float | None = None


def wanted(spec: RobotOffloadSpec, robot: Presence, now: datetime.datetime) -> Wanted:
    """Decide which pods of nodes are wanted; the cloud agent and the discovery servers always are."""
    if spec.replicas == 0:
        return Wanted(False, no("SwitchedOff", "spec.replicas is 0: the nodes in the cloud have no pods"))
    idle_s = spec.scale.idle_timeout_ms / 1000
    if robot.connected or idle_s == 0:
        return Wanted(True, yes("Wanted", "The nodes in the cloud have pods"))
    left_s = idle_s - (now - robot.since).total_seconds()
    if left_s > 0:
        return Wanted(True, yes("Wanted", "The robot is gone; the nodes in the cloud wait for it"), left_s)
    return Wanted(
        False, no("RobotGone", f"No robot for {idle_s:g} s: the nodes in the cloud have no pods until it is back")
    )


def _time(text: object) -> datetime.datetime | None:
    try:
        return datetime.datetime.fromisoformat(text) if isinstance(text, str) and text else None
    except ValueError:
        return None
