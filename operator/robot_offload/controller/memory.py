"""The controller's memory of an object between two passes. Losing it costs requests, never correctness."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from robot_offload.controller.observe import CachedConfig
from robot_offload.decide.plan import History
from robot_offload.decide.presence import Sighting
from robot_offload.decide.renewal import Answer
from robot_offload.decide.verdicts import Verdict

EVENTS_AT_ONCE: Final = 25
EVENT_EVERY_S: Final = 300.0
"""Limit of Events for one object, from client-go (defaultSpamBurst, defaultSpamQPS)."""


@dataclass(slots=True)
class Allowance:
    """A token bucket: a first amount, and one more token after each period.

    Attributes:
        left: tokens in the bucket.
        filled_s: when the bucket was last filled, on the steady clock.
    """

    left: float = EVENTS_AT_ONCE
    filled_s: float | None = None

    def take(self, now_s: float) -> bool:
        """Take one token; return whether there was one."""
        passed_s = now_s - (now_s if self.filled_s is None else self.filled_s)
        self.left = min(float(EVENTS_AT_ONCE), self.left + passed_s / EVENT_EVERY_S)
        self.filled_s = now_s
        if self.left < 1.0:
            return False
        self.left -= 1.0
        return True


@dataclass(frozen=True, slots=True)
class Certified:
    """The last result for the Secrets with certificates, so that not every pass reads keys.

    Attributes:
        based_on: generation, revocation, the robot's request and the versions of the Secrets.
        verdict: for the condition CertificatesReady.
        hash: of the cloud's certificate.
        renewal_s: time of the first renewal, on the steady clock.
        answer: to the robot's request; None: there is no request.
        ends: serial numbers and ends of the leaves, as in the status.
    """

    based_on: object
    verdict: Verdict
    hash: str
    renewal_s: float
    answer: Answer | None
    ends: Mapping[str, Any]


@dataclass(slots=True)
class Memory:
    """The memory of one RobotOffload, by its uid.

    Attributes:
        uid: of the RobotOffload; another uid under the same name starts anew.
        history: what earlier passes learnt about the children.
        authorities: the same for the Secrets in the operator's namespace.
        sighting: the robot's Lease.
        configs: the users' ConfigMaps that it reads, by name.
        lease: the meaning of the robot's Lease when it was last read (`presence.meaning`); None: it did not exist.
        unchanged: the input of the last full pass; None: it left something to do.
        due_s: when time alone may change something, on the steady clock.
        however_s: the same, whether or not the robot's Lease moves meanwhile.
        secrets: input and result of the decision about certificates.
        status: the part of the last seen or written status that the metrics need (`summary`).
        refusals: what the API server refused for good in the last pass; a repetition is not worth a retry.
        failures: failed passes in a row.
        events: how many more Events may be posted.
    """

    uid: str
    history: History = field(default_factory=History)
    authorities: History = field(default_factory=History)
    sighting: Sighting | None = None
    configs: dict[str, CachedConfig] = field(default_factory=dict)
    lease: tuple[Any, ...] | None = None
    unchanged: object = None
    due_s: float = float("inf")
    however_s: float = float("inf")
    secrets: Certified | None = None
    status: Mapping[str, Any] = field(default_factory=dict)
    refusals: frozenset[str] = frozenset()
    failures: int = 0
    events: Allowance = field(default_factory=Allowance)


def summary(status: Mapping[str, Any]) -> dict[str, Any]:
    """Return the few entries of a status that are kept: whole ones of hundreds of objects would be megabytes."""
    return {
        "placement": status.get("placement"),
        "robot": {"connected": bool((status.get("robot") or {}).get("connected"))},
        "certificates": {role: one["notAfter"] for role, one in (status.get("certificates") or {}).items() if one},
        "conditions": tuple(
            {"type": condition["type"], "status": condition["status"]} for condition in status.get("conditions") or ()
        ),
        "build": next(
            (one["reason"] for one in status.get("conditions") or () if one["type"] == "ImageBuilt"), "NotNeeded"
        ),
    }
