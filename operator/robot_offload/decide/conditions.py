"""The conditions of the status, each from a pure check, and `Ready`, which summarizes them."""

from __future__ import annotations

import datetime
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

from robot_offload.api.v1alpha1.status import CLOUD_TYPES, CONDITION_TYPES
from robot_offload.decide.verdicts import FOR_PEOPLE, Truth, Verdict, gravest, no, unknown, yes
from robot_offload.findings import Finding
from robot_offload.kube.port import Manifest

MAX_MESSAGE: Final = 32_768
"""Characters in a message: the schema's limit."""


def spec_valid(errors: Sequence[Finding], warnings: Sequence[Finding] = ()) -> Verdict:
    """Return whether the specification can be used; the message has every problem, one a line."""
    if errors:
        lines = "\n".join(finding.line() for finding in errors)
        return no(errors[0].reason, f"{lines}\nThe children stay as they are until this is corrected")
    if warnings:
        return yes("ValidWithWarnings", "\n".join(finding.line() for finding in warnings))
    return yes("Valid", "The specification is valid")


def discovery_ready(servers: int, verdicts: Iterable[Verdict]) -> Verdict:
    """Return whether the nodes in the cloud find each other. One server of several is enough."""
    if servers == 0:
        return yes("NotNeeded", "This transport runs no discovery servers")
    found = list(verdicts)
    good = sum(verdict.holds for verdict in found)
    if good == servers:
        return yes("Available", f"{servers} of {servers} discovery servers are ready")
    bad = gravest(verdict for verdict in found if not verdict.holds)
    why = bad.message if bad else "they are being made"
    if good:
        return yes("Degraded", f"{good} of {servers} discovery servers are ready: {why}")
    return no(bad.reason if bad else "NotMade", f"No discovery server is ready: {why}")


def ready(verdicts: Mapping[str, Verdict]) -> Verdict:
    """Return whether the cloud can serve the robot, wherever the robot is.

    False with the reason of the first false condition, those that wait for a person before those that time may mend;
    else Unknown with the reason of the first unknown.
    """
    for truth, make in (("False", no), ("Unknown", unknown)):
        found = {name: verdicts[name] for name in CLOUD_TYPES if name in verdicts and verdicts[name].truth == truth}
        worst = gravest(found.values())
        if worst is not None:
            name = next(name for name, verdict in found.items() if verdict is worst)
            return make(worst.reason, f"{name}: {worst.message}")
    return yes("Ready", "The cloud can serve the robot")


def progress(summed: Verdict) -> dict[str, Verdict]:
    """Return whether what is not ready will become so by itself (Reconciling) or waits for a person (Stalled)."""
    if summed.holds:
        return {}
    name = "Stalled" if summed.reason in FOR_PEOPLE or summed.message.startswith("SpecValid:") else "Reconciling"
    return {name: yes(summed.reason, summed.message)}


def conditions(
    verdicts: Mapping[str, Verdict], before: Iterable[Manifest], generation: int, now: datetime.datetime
) -> list[dict[str, Any]]:
    """Return the list for the status, in its fixed order.

    Args:
        verdicts: by type, without Ready. A missing type keeps its last condition.
        before: the conditions as last written.
        generation: of the verdicts.
        now: our wall clock.
    """
    old = {condition["type"]: condition for condition in before}
    summed = {name: verdicts.get(name) or _kept(old.get(name)) for name in CONDITION_TYPES if name != "Ready"}
    known = {name: verdict for name, verdict in summed.items() if verdict is not None}
    summed_up = ready(known)
    result = []
    for name, verdict in {**known, "Ready": summed_up, **progress(summed_up)}.items():
        if name not in verdicts and name in known:
            result.append(dict(old[name]))
        else:
            result.append(_condition(name, verdict, old.get(name), generation, now))
    return result


def timestamp(moment: datetime.datetime) -> str:
    """Return a time as Kubernetes writes it: UTC, whole seconds."""
    return moment.astimezone(datetime.UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def _kept(condition: Manifest | None) -> Verdict | None:
    if condition is None:
        return None
    truth: Truth = condition["status"]
    return Verdict(truth, condition.get("reason", ""), condition.get("message", ""))


def _condition(
    name: str, verdict: Verdict, before: Manifest | None, generation: int, now: datetime.datetime
) -> dict[str, Any]:
    moved = before is None or before.get("status") != verdict.truth
    return {
        "type": name,
        "status": verdict.truth,
        "reason": verdict.reason,
        "message": _cut(verdict.message),
        "observedGeneration": generation,
        "lastTransitionTime": timestamp(now) if moved or before is None else before["lastTransitionTime"],
    }


def _cut(text: str) -> str:
    return text if len(text) <= MAX_MESSAGE else f"{text[: MAX_MESSAGE - 3]}..."
