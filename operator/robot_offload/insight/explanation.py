"""Why a RobotOffload is not Ready, in the order in which a person would ask. Pure."""

from __future__ import annotations

import datetime
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

from robot_offload.api.agent_state import AgentState
from robot_offload.api.v1alpha1.status import PROGRESS_TYPES, ROBOT_TYPES
from robot_offload.insight import in_flight
from robot_offload.insight.handover import handover
from robot_offload.insight.next_steps import advice, asks_for_bundle
from robot_offload.insight.observed import READY, Condition, Observed, ago, time_of
from robot_offload.insight.timing import timing

EVENTS: Final = 5
BUNDLE_NEEDS: Final = ("SpecValid", "CertificatesReady", "AddressesReady")
"""Without them `bundle` waits, so its advice would lead back to `explain`."""
FIRST_THE_ABOVE: Final = "Mend what stands above first: until then no bundle can be written."
EPOCH: Final = datetime.datetime(1970, 1, 1, tzinfo=datetime.UTC)


@dataclass(frozen=True, slots=True)
class Problem:
    """One problem of a RobotOffload.

    Attributes:
        condition: the type of the condition.
        reason: one CamelCase word.
        message: the operator's message.
        since: how long, e.g. `3m`.
        meaning: of the reason.
        step: what to do.
    """

    condition: str
    reason: str
    message: str
    since: str
    meaning: str
    step: str


@dataclass(frozen=True, slots=True)
class Explanation:
    """The explanation of a RobotOffload.

    Attributes:
        ready: whether it is Ready: the cloud can serve the robot, wherever the robot is.
        headline: the answer in one line.
        problems: the causes first.
        notes: what is right but may be surprising.
        events: the last warnings about it and its children.
    """

    ready: bool
    headline: str
    problems: tuple[Problem, ...]
    notes: tuple[str, ...]
    events: tuple[str, ...]


def explain(
    offload: Observed,
    *,
    deleting: bool,
    events: Sequence[Mapping[str, Any]],
    now: datetime.datetime,
    state: AgentState | None = None,
) -> Explanation:
    """Explain one RobotOffload.

    Args:
        offload: as observed.
        deleting: whether it is being deleted.
        events: of its namespace; those about other objects are ignored.
        now: the present.
        state: its agent's present state; None: it cannot be asked.
    """
    problems = tuple(_problems(offload, deleting, now))
    cloud = [problem for problem in problems if problem.condition not in ROBOT_TYPES]
    name = f"{offload.namespace}/{offload.name}"
    headline = f"{name} is not Ready: {cloud[0].reason}" if cloud else f"{name} is Ready"
    if problems and not cloud:
        headline += f"; the robot: {problems[0].reason}"
    return Explanation(
        ready=not cloud,
        headline=headline,
        problems=problems,
        notes=(*_notes(offload), *(in_flight.sentences(state) if state is not None else ())),
        events=tuple(event_lines(offload.name, events, now)),
    )


def _problems(offload: Observed, deleting: bool, now: datetime.datetime) -> Iterator[Problem]:
    if deleting:
        yield _own("BeingDeleted", offload, "")
        return
    if not offload.conditions:
        yield _own("NoStatus", offload, ago(offload.created, now))
        return
    if offload.outdated:
        yield _own("InProgress", offload, "")
    bundled = all(found is None or found.holds for found in map(offload.condition, BUNDLE_NEEDS))
    for condition in offload.conditions:
        if not condition.holds and condition.type != READY and condition.type not in PROGRESS_TYPES:
            problem = _problem(condition, offload, now)
            yield problem if bundled or not asks_for_bundle(problem.step) else replace(problem, step=FIRST_THE_ABOVE)
    # An operator whose conditions have no more details.
    summary = offload.condition(READY)
    others = [each for each in offload.conditions if each.type not in (READY, *ROBOT_TYPES, *PROGRESS_TYPES)]
    if summary is not None and not summary.holds and all(each.holds for each in others) and not offload.outdated:
        yield _problem(summary, offload, now)


def _own(reason: str, offload: Observed, since: str) -> Problem:
    found = advice(READY, reason)
    return Problem(READY, reason, "", since, found.meaning, found.at(offload.namespace, offload.name))


def _problem(condition: Condition, offload: Observed, now: datetime.datetime) -> Problem:
    found = advice(condition.type, condition.reason)
    return Problem(
        condition=condition.type,
        reason=condition.reason,
        message=condition.message,
        since=ago(condition.since, now),
        meaning=found.meaning,
        step=found.at(offload.namespace, offload.name),
    )


def _notes(offload: Observed) -> Iterator[str]:
    """Yield what is as declared and yet explains which side acts."""
    if offload.pin_ended:
        side, _, at = offload.pin_ended.partition(" ")
        yield f"The pin to {side} ended at {at}; it stands in the specification and counts no more."
    if offload.pin != "Auto":
        until = f" until {offload.pinned_until}" if offload.pinned_until else ""
        yield f"It is pinned to {offload.pin}{until}; kubectl offload pin {offload.name} auto lets it decide again."
    if offload.mode == "Observe":
        yield "spec.switching.mode is Observe: it decides and says so, but never switches."
    if offload.replicas == 0:
        yield f"spec.replicas is 0; kubectl scale roff/{offload.name} --replicas=1 switches the cloud side on."
    if offload.placement_message:
        yield f"It acts on side {offload.placement}: {offload.placement_reason}, {offload.placement_message}"
    yield from timing(offload.spec)
    yield from handover(offload.spec)
    applied = offload.condition("ResourcesApplied")
    if applied is not None and applied.reason == "AppliedWithAdditions":
        yield f"{applied.message}."
    warned = offload.condition("SpecValid")
    if warned is not None and warned.reason == "ValidWithWarnings":
        yield from (f"Warning: {line}" for line in warned.message.splitlines())


def event_lines(
    name: str,
    events: Iterable[Mapping[str, Any]],
    now: datetime.datetime,
    *,
    types: Sequence[str] = ("Warning",),
    most: int = EVENTS,
) -> Iterator[str]:
    """Yield the last events of these types about a RobotOffload or its children, each once, the newest last."""
    found: dict[str, tuple[datetime.datetime, str]] = {}
    for event in events:
        about = event.get("involvedObject") or event.get("regarding") or {}
        owner = str(about.get("name", ""))
        if event.get("type") not in types or not (owner == name or owner.startswith(f"{name}-")):
            continue
        text = f"{about.get('kind')} {owner}: {event.get('reason')}: {event.get('message') or event.get('note') or ''}"
        last = str(event.get("lastTimestamp") or event.get("eventTime") or "")
        found[text] = max(found.get(text, (EPOCH, "")), (time_of(last) or EPOCH, last))
    for text, (_, last) in sorted(found.items(), key=lambda each: each[1][0])[-most:]:
        yield f"{ago(last, now) or '?'} ago, {text}"
