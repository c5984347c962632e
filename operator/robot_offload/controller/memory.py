"""What the controller remembers of an object between two passes. Losing it costs requests, never correctness."""

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
"""How many Events one object may post: the limits of client-go (defaultSpamBurst, defaultSpamQPS)."""


@dataclass(slots=True)
class Allowance:
    """A bucket of tokens: so many at once, and one more after each period.

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
    """What the Secrets with certificates were last found to be, so that keys are not read in every pass.

    Attributes:
        based_on: generation, revocation, the robot's request and the versions of the Secrets.
        verdict: for the condition CertificatesReady.
        hash: of the cloud's certificate.
        renewal_s: when the first of them is to be renewed, on the steady clock.
        answer: to the robot's request; None: it has none.
        ends: serial numbers and ends of the leaves, as the status names them.
    """

    based_on: object
    verdict: Verdict
    hash: str
    renewal_s: float
    answer: Answer | None
    ends: Mapping[str, Any]


@dataclass(slots=True)
class Memory:
    """What is remembered of one RobotOffload, by its uid.

    Attributes:
        uid: whose memory it is; another uid under the same name starts anew.
        history: what earlier passes have learnt about the children.
        authorities: the same about the Secrets in the operator's namespace.
        sighting: the robot's Lease.
        configs: the ConfigMaps of users that it reads, by name.
        lease: what the robot's Lease said when it was last read (`presence.meaning`); None: there was none.
        unchanged: what the last full pass was made of; None: it left something to do.
        due_s: when time alone may change something, on the steady clock.
        however_s: the same, however the robot's Lease moves meanwhile.
        secrets: what the certificates were decided from, and what came of it.
        status: what the metrics need of the status as it was last seen or written (`summary`).
        refusals: what the API server refused for good in the last pass; the same again is not worth a retry.
        failures: passes in a row that a step has broken off.
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
    """Return the few words of a status that are kept: whole ones of hundreds of objects would be megabytes."""
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
