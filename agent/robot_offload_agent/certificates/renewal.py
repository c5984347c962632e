"""When the robot requests another certificate, and how it handles the answer. Pure.

A key from a bundle is replaced as soon as a cloud that can sign is there; an own key at two thirds of its life.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, replace

from robot_offload_agent.certificates.openssl import Certificate

SHARE = 2 / 3
"""Share of a certificate's life after which the next is requested, as ACME clients do; a third is left for trouble."""
RETRY_S = 6 * 3600.0
"""Wait after a refusal, or after the disk could not store it."""
MAX_ANSWER = 16_384
"""Most characters of an answer. One has about 1,100."""


@dataclass(frozen=True)
class Renewal:
    """State. `again_s` is on the steady clock.

    Attributes:
        certificate: with which the robot dials; None: not read yet.
        bundled: the certificate is that of the bundle.
        busy: a key is being made, or a certificate stored.
        request: waits for its answer; "" for none.
        again_s: before this moment nothing is tried.
        reason, message: why there is no other certificate though one is due; "" for no reason.
    """

    certificate: Certificate | None = None
    bundled: bool = False
    busy: bool = False
    request: str = ""
    again_s: float = 0.0
    reason: str = ""
    message: str = ""


@dataclass(frozen=True)
class Found:
    """The current certificate was read."""

    certificate: Certificate
    bundled: bool


@dataclass(frozen=True)
class Asking:
    """A request is ready to be sent."""

    request: str


@dataclass(frozen=True)
class Failed:
    """The key could not be made, or the certificate could not be stored."""

    message: str


@dataclass(frozen=True)
class Heard:
    """Notes of the cloud: whether certificates are signed there, and the answer to the robot's request; "" for none."""

    signs: bool
    answer: str


Event = Found | Asking | Failed | Heard


@dataclass(frozen=True)
class MakeRequest:
    """Make a key and a request, or find a pair that waits."""


@dataclass(frozen=True)
class Keep:
    """Make this certificate the current one."""

    pem: str


@dataclass(frozen=True)
class Drop:
    """Delete the key that waits: its request was refused."""


Command = MakeRequest | Keep | Drop


def step(renewal: Renewal, event: Event, now_s: float, wall_s: float) -> tuple[Renewal, Command | None]:
    """Process one event; `now_s` is the steady clock, `wall_s` the system clock."""
    if isinstance(event, Heard):
        return _heard(renewal, event, now_s, wall_s)
    if isinstance(event, Found):
        return Renewal(event.certificate, event.bundled), None
    if isinstance(event, Asking):
        return replace(renewal, busy=False, request=event.request), None
    again_s = now_s + RETRY_S
    stuck = replace(renewal, busy=False, request="", again_s=again_s, reason="RenewalFailed", message=event.message)
    return stuck, None


def due(renewal: Renewal, wall_s: float) -> bool:
    """Return whether another certificate is wanted. A clock before the certificate's begin is wrong: wait."""
    found = renewal.certificate
    if found is None:
        return False
    return renewal.bundled or wall_s >= found.begin_s + (found.end_s - found.begin_s) * SHARE


def digest(request: str) -> str:
    """Return the digest that names a request in its answer."""
    return hashlib.sha256(request.encode()).hexdigest()[:16]


def asked_in(answer: str) -> str:
    """Return the digest of the request that a text answers; "" if it is not an answer."""
    return _read(answer)[0]


def _heard(renewal: Renewal, event: Heard, now_s: float, wall_s: float) -> tuple[Renewal, Command | None]:
    if renewal.busy:
        return renewal, None
    if renewal.request:
        asked, reason, message, pem = _read(event.answer)
        if not asked or asked != digest(renewal.request):
            return renewal, None
        if pem:
            return replace(renewal, busy=True, request=""), Keep(pem)
        return replace(renewal, request="", again_s=now_s + RETRY_S, reason=reason, message=message), Drop()
    if event.signs and now_s >= renewal.again_s and due(renewal, wall_s):
        return replace(renewal, busy=True), MakeRequest()
    return renewal, None


def _read(answer: str) -> tuple[str, str, str, str]:
    """Return (request, reason, message, certificate) of an answer; all empty when it is not valid."""
    if not answer or len(answer) > MAX_ANSWER:
        return "", "", "", ""
    try:
        body = json.loads(answer)
        fields = [body[name] for name in ("request", "reason", "message", "certificate")]
    except (ValueError, RecursionError, KeyError, TypeError):
        return "", "", "", ""
    if not all(isinstance(value, str) for value in fields):
        return "", "", "", ""
    asked, reason, message, pem = fields
    return asked, reason[:64] if reason.isalpha() else "Refused", message[:1024], pem
