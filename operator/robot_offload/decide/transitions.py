"""The changes of the status that become Kubernetes Events: transitions only, so a quiet object has none."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal

from robot_offload.decide.trail import restarted

_TOLD: Final = (
    *("SpecValid", "ResourcesApplied", "ImageBuilt", "Connected", "ConfigCurrent", "CertificatesReady"),
    *("AddressesReady", "CertificateCurrent", "Ready"),
)
"""Ready covers DiscoveryReady and WorkloadsAvailable: pods come and go for many reasons."""
_MAX_MESSAGE: Final = 1024


@dataclass(frozen=True, slots=True)
class Transition:
    """An event to post.

    Attributes:
        type: Normal or Warning.
        reason: one CamelCase word.
        message: a sentence.
    """

    type: Literal["Normal", "Warning"]
    reason: str
    message: str


def transitions(before: Mapping[str, Any], after: Mapping[str, Any]) -> tuple[Transition, ...]:
    """Return the events between two statuses."""
    old = {condition["type"]: condition for condition in before.get("conditions") or ()}
    told = [*_conditions(old, after.get("conditions") or ())]
    sites = before.get("placement", "Unknown"), after.get("placement", "Unknown")
    if sites[0] != sites[1]:
        reason, message = after.get("placementReason") or "Unknown", after.get("placementMessage") or ""
        told.append(Transition("Normal", f"Placement{sites[1]}", _cut(f"{reason}: {message}")))
    broken = restarted(before.get("audit") or {}, after.get("audit") or {})
    if broken:
        told.append(Transition("Warning", "AuditTrailRestarted", broken))
    ended = (after.get("pin") or {}).get("ended")
    if ended and ended != (before.get("pin") or {}).get("ended"):
        side, _, at = ended.partition(" ")
        told.append(
            Transition("Normal", "PinEnded", f"The pin to the {side.lower()} ended at {at}; the policy decides")
        )
    return tuple(told)


def _conditions(old: Mapping[str, Mapping[str, Any]], new: Iterable[Mapping[str, Any]]) -> Iterable[Transition]:
    for condition in new:
        name, status = condition["type"], condition["status"]
        before = old.get(name)
        # The first pass finds most things unfinished; that it was applied, or must be corrected, is worth an event.
        first = before is None and (name == "ResourcesApplied" or (name == "SpecValid" and status == "False"))
        moved = before is not None and before["status"] != status
        if name not in _TOLD or not (first or moved):
            continue
        fine = status == "True"
        if status == "Unknown" and before is not None and name != "Ready":
            continue
        reason = condition["reason"] if not fine or name == "Connected" else f"{name}"
        yield Transition("Normal" if fine else "Warning", reason, _cut(f"{name}: {condition['message']}"))


def _cut(text: str) -> str:
    return text if len(text) <= _MAX_MESSAGE else f"{text[: _MAX_MESSAGE - 3]}..."
