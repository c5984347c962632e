"""What to write into the robot's Lease, and when. Pure: the state, the time and the last writes come in.

The Lease is renewed only while the robot is connected, so it ends by itself when the robot, the agent, this reporter or
the whole pod is gone; the operator times it with its own clock. Writes: every RENEW_S while the robot is connected, at
each transition, and never faster than GAP_S (of a flapping link the newest state is reported).
"""

from __future__ import annotations

import datetime
import json
from dataclasses import dataclass
from typing import Any, Final

from robot_offload.api.agent_state import ANNOTATION, Sight, lasting

RENEW_S: Final = 10.0
GAP_S: Final = 1.0
FIRST_PAUSE_S: Final = 1.0
LONGEST_PAUSE_S: Final = 10.0
"""The Lease is renewed within this time after an outage of the API server."""


@dataclass(frozen=True, slots=True)
class Report:
    """A wanted content of the Lease.

    Attributes:
        text: the state as compact JSON without live numbers.
        connected: whether the robot is connected, that is, whether the Lease is renewed.
        since: RFC 3339 time of the last change of `connected`.
    """

    text: str
    connected: bool
    since: str


@dataclass(frozen=True, slots=True)
class Mirror:
    """The known state of the Lease.

    Attributes:
        written: the last report that the API server accepted; None: none by this process.
        written_s: when that was, on the steady clock.
        failures: failed writes in a row.
        retry_s: nothing is tried before this moment.
    """

    written: Report | None = None
    written_s: float = float("-inf")
    failures: int = 0
    retry_s: float = float("-inf")


def report(sight: Sight, now_s: float) -> Report | None:
    """Return the wanted content of the Lease; None: nothing is known yet, so an earlier reporter's content stays.

    A silent agent is reported once: its robot may continue by itself, but nothing here can confirm it.
    """
    if sight.state is None:
        return None
    text = lasting(sight.text)
    if sight.fresh(now_s):
        return Report(text, sight.state.connected, sight.state.since)
    values = json.loads(text)
    values |= {
        "connected": False,
        "site": "unknown",
        "ready": False,
        "reason": "AgentSilent",
        "message": "the cloud agent has stopped writing its state",
    }
    return Report(json.dumps(values, separators=(",", ":"), sort_keys=True), False, sight.state.since)


def due(mirror: Mirror, wanted: Report | None, now_s: float) -> bool:
    """Return whether the Lease should be written now."""
    if wanted is None or now_s < mirror.retry_s or now_s - mirror.written_s < GAP_S:
        return False
    if mirror.written is None or mirror.failures:
        return True
    if wanted != mirror.written and _news(wanted) != _news(mirror.written):
        return True
    return wanted.connected and now_s - mirror.written_s >= RENEW_S


def _news(report: Report) -> object:
    """Return the part that is worth a write of its own: the head of the audit trail waits for the next renewal."""
    values = json.loads(report.text)
    values.pop("audit", None)
    return values, report.connected, report.since


def patch(wanted: Report, robot: str, now: datetime.datetime) -> dict[str, Any]:
    """Return the merge patch of the Lease.

    Args:
        wanted: its content.
        robot: the robot's name.
        now: the present, with its time zone.
    """
    spec: dict[str, Any] = {"holderIdentity": robot if wanted.connected else None}
    if wanted.connected:
        spec["renewTime"] = _micro_time(now)
        spec["acquireTime"] = _micro_time(_time(wanted.since) or now)
    return {"metadata": {"annotations": {ANNOTATION: wanted.text}}, "spec": spec}


def succeeded(wanted: Report, now_s: float) -> Mirror:
    """Return the mirror after a write."""
    return Mirror(written=wanted, written_s=now_s)


def failed(mirror: Mirror, now_s: float) -> Mirror:
    """Return the mirror after a failed write: pauses grow, and the next write has the state of its own moment."""
    pause_s = min(LONGEST_PAUSE_S, FIRST_PAUSE_S * 2.0 ** min(mirror.failures, 8))
    return Mirror(mirror.written, mirror.written_s, mirror.failures + 1, now_s + pause_s)


def _micro_time(moment: datetime.datetime) -> str:
    """Format a MicroTime for Kubernetes: always six digits after the point."""
    return moment.astimezone(datetime.UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ")


def _time(text: str) -> datetime.datetime | None:
    try:
        moment = datetime.datetime.fromisoformat(text)
    except ValueError:
        return None
    return moment if moment.tzinfo else None
