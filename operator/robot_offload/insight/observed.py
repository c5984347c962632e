"""A live RobotOffload for the command line: plain values from any content of the API server.

Pure and tolerant: a status of an older or newer operator, or none at all, is shown as far as possible.
"""

from __future__ import annotations

import datetime
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from robot_offload.api.v1alpha1 import pinned
from robot_offload.api.v1alpha1.status import CONDITION_TYPES
from robot_offload.objects.facts import Endpoint

READY: Final = "Ready"


@dataclass(frozen=True, slots=True)
class Condition:
    """One condition of a status.

    Attributes:
        type: SpecValid, Ready and so on.
        status: True, False or Unknown.
        reason: one CamelCase word.
        message: one sentence.
        since: RFC 3339 time of the last change; empty: not known.
    """

    type: str
    status: str
    reason: str
    message: str
    since: str = ""

    @property
    def holds(self) -> bool:
        """Whether it is true."""
        return self.status == "True"


@dataclass(frozen=True, slots=True)
class NodeSeen:
    """The cloud's replica of one node, from the status."""

    name: str
    workload: str
    replicas: int
    ready: bool
    message: str
    image: str = ""
    commit: str = ""


@dataclass(frozen=True, slots=True)
class Observed:
    """One live RobotOffload.

    Attributes:
        namespace: its Kubernetes namespace.
        name: its name.
        uid: its identity.
        created: RFC 3339 time of its creation.
        generation: of its specification.
        observed_generation: the last one that the operator processed; None: none yet.
        transport: the type of transport; the rest of the specification is in `spec`.
        pin: the one in force: Auto, Robot or Cloud.
        pinned_until: RFC 3339 time of its end; empty: until it is removed.
        pin_ended: side and end of an expired pin; empty: there is none.
        mode: Auto or Observe.
        replicas: 1, or 0 when the cloud side is switched off.
        placement: Robot, Cloud or Unknown.
        placement_reason: one word.
        placement_message: one sentence.
        connected: whether the robot is connected.
        since: RFC 3339 time of the last change of `connected`.
        robot_generation: the generation whose settings the robot runs.
        nodes_ready: `3/3`.
        nodes: the replicas in the cloud.
        endpoints: the cloud's addresses for the robot.
        conditions: in the order in which they become true.
        spec: as written.
    """

    namespace: str
    name: str
    uid: str
    created: str
    generation: int
    observed_generation: int | None
    transport: str
    pin: str
    mode: str
    replicas: int
    placement: str
    placement_reason: str
    placement_message: str
    connected: bool
    since: str
    robot_generation: int | None
    nodes_ready: str
    nodes: tuple[NodeSeen, ...]
    endpoints: tuple[Endpoint, ...]
    conditions: tuple[Condition, ...]
    spec: Mapping[str, Any]
    pinned_until: str = ""
    pin_ended: str = ""

    def condition(self, wanted: str) -> Condition | None:
        """Return the condition of this type, if there is one."""
        return next((condition for condition in self.conditions if condition.type == wanted), None)

    @property
    def ready(self) -> bool:
        """Whether everything is as it should be, for the present specification."""
        summary = self.condition(READY)
        return summary is not None and summary.holds and not self.outdated

    @property
    def outdated(self) -> bool:
        """Whether the operator has not yet processed the present specification."""
        return self.observed_generation != self.generation


def observe(manifest: Mapping[str, Any]) -> Observed:
    """Read a live RobotOffload."""
    metadata = manifest.get("metadata") or {}
    spec = manifest.get("spec") or {}
    status = manifest.get("status") or {}
    switching = spec.get("switching") or {}
    hold = pinned.observed(manifest)
    robot = status.get("robot") or {}
    return Observed(
        namespace=str(metadata.get("namespace", "")),
        name=str(metadata.get("name", "")),
        uid=str(metadata.get("uid", "")),
        created=str(metadata.get("creationTimestamp") or ""),
        generation=int(metadata.get("generation") or 0),
        observed_generation=status.get("observedGeneration"),
        transport=str((spec.get("transport") or {}).get("type") or "Zenoh"),
        pin=hold.side,
        mode=str(switching.get("mode") or "Auto"),
        replicas=int(spec.get("replicas", 1)),
        placement=str(status.get("placement") or "Unknown"),
        placement_reason=str(status.get("placementReason") or ""),
        placement_message=str(status.get("placementMessage") or ""),
        connected=bool(robot.get("connected")),
        since=str(robot.get("since") or ""),
        robot_generation=robot.get("generation"),
        nodes_ready=str(status.get("nodesReady") or ""),
        nodes=tuple(_nodes(status.get("nodes") or ())),
        endpoints=tuple(_endpoints(status.get("endpoints") or ())),
        conditions=_conditions(status.get("conditions") or ()),
        spec=spec,
        pinned_until="" if hold.until is None else hold.until.isoformat(timespec="seconds"),
        pin_ended=hold.ended,
    )


def _nodes(nodes: Sequence[Mapping[str, Any]]) -> Iterator[NodeSeen]:
    for node in nodes:
        yield NodeSeen(
            name=str(node.get("name", "")),
            workload=str(node.get("workload") or ""),
            replicas=int(node.get("replicas") or 0),
            ready=bool(node.get("ready")),
            message=str(node.get("message") or ""),
            image=str(node.get("image") or ""),
            commit=str(node.get("commit") or ""),
        )


def _endpoints(endpoints: Sequence[Mapping[str, Any]]) -> Iterator[Endpoint]:
    for endpoint in endpoints:
        yield Endpoint(endpoint["purpose"], endpoint["protocol"], str(endpoint["host"]), int(endpoint["port"]))


def _conditions(conditions: Sequence[Mapping[str, Any]]) -> tuple[Condition, ...]:
    found = [
        Condition(
            type=str(condition.get("type", "")),
            status=str(condition.get("status") or "Unknown"),
            reason=str(condition.get("reason") or ""),
            message=str(condition.get("message") or ""),
            since=str(condition.get("lastTransitionTime") or ""),
        )
        for condition in conditions
    ]
    order = {name: place for place, name in enumerate(CONDITION_TYPES)}
    return tuple(sorted(found, key=lambda condition: order.get(condition.type, len(order))))


def ago(since: str, now: datetime.datetime) -> str:
    """Return how long ago a moment was, as kubectl writes it: `45s`, `12m`, `3h`, `8d`; empty if not known."""
    moment = time_of(since)
    if moment is None:
        return ""
    seconds = max(0, int((now - moment).total_seconds()))
    for unit, length, up_to in (("s", 1, 120), ("m", 60, 7200), ("h", 3600, 172_800)):
        if seconds < up_to:
            return f"{seconds // length}{unit}"
    return f"{seconds // 86_400}d"


def time_of(text: str) -> datetime.datetime | None:
    """Parse an RFC 3339 time; return None if it is not one, or has no time zone."""
    try:
        moment = datetime.datetime.fromisoformat(text)
    except ValueError:
        return None
    return moment if moment.tzinfo else None
