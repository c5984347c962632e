"""Writes the status where it differs, and posts its transitions as Events. The only place that does either."""

from __future__ import annotations

import secrets
from collections.abc import Mapping
from typing import Any, Final

import structlog

from robot_offload.controller.clock import Clock
from robot_offload.controller.memory import Memory, summary
from robot_offload.controller.store import Store
from robot_offload.decide import conditions, status, transitions
from robot_offload.kube.errors import InvalidObjectError, KubeError
from robot_offload.kube.kinds import EVENT, ROBOT_OFFLOAD
from robot_offload.kube.port import KubeApi, Manifest
from robot_offload.objects import labels

COMPONENT: Final = "robot-offload-operator"
_log = structlog.get_logger("robot_offload.controller")


async def publish(
    api: KubeApi, store: Store, raw: Manifest, after: Mapping[str, Any], memory: Memory, clock: Clock
) -> int:
    """Writes the status where it differs and posts the transitions; returns the number of writes."""
    before = raw.get("status") or {}
    metadata = raw["metadata"]
    change = status.patch(before, after)
    if not change:
        return 0
    answer = await _write(api, raw, change)
    store.put(ROBOT_OFFLOAD, answer)
    memory.status = summary(answer.get("status") or after)
    posted = 0
    for event in transitions.transitions(before, after):
        if not memory.events.take(clock.steady_s()):
            _log.warning("Left out an event: too many of late", name=metadata["name"], reason=event.reason)
            continue
        try:
            await api.create(_event(raw, event, clock))
            posted += 1
        except KubeError as error:
            # An event is a courtesy: losing one must not undo the pass.
            _log.warning("Lost an event", name=metadata["name"], namespace=metadata["namespace"], error=str(error))
    return 1 + posted


async def _write(api: KubeApi, raw: Manifest, change: Mapping[str, Any]) -> Manifest:
    """Writes a change of the status. Fields that the API server does not take are left out, and the rest is written."""
    metadata = raw["metadata"]
    body = {
        "apiVersion": ROBOT_OFFLOAD.api_version,
        "kind": ROBOT_OFFLOAD.kind,
        "metadata": {key: metadata[key] for key in ("namespace", "name", "uid", "resourceVersion")},
    }
    try:
        return await api.patch_status({**body, "status": dict(change)})
    except InvalidObjectError as error:
        refused = {path.split(".")[1].partition("[")[0] for path, _ in error.details if path.startswith("status.")}
        rest = {name: value for name, value in change.items() if name not in refused}
        if not refused or not rest:
            raise
        _log.error("The API server refuses a part of the status", name=metadata["name"], parts=sorted(refused))
        return await api.patch_status({**body, "status": rest})


def _event(raw: Manifest, posted: transitions.Transition, clock: Clock) -> Manifest:
    metadata = raw["metadata"]
    moment = conditions.timestamp(clock.wall())
    return {
        "apiVersion": EVENT.api_version,
        "kind": EVENT.kind,
        "metadata": {
            "name": f"{metadata['name']}.{secrets.token_hex(6)}",
            "namespace": metadata["namespace"],
            "labels": {labels.MANAGED_BY: labels.MANAGER},
        },
        "involvedObject": {
            "apiVersion": raw["apiVersion"],
            "kind": raw["kind"],
            "namespace": metadata["namespace"],
            "name": metadata["name"],
            "uid": metadata["uid"],
            "resourceVersion": metadata["resourceVersion"],
        },
        "type": posted.type,
        "reason": posted.reason,
        "message": posted.message,
        "source": {"component": COMPONENT},
        "reportingComponent": COMPONENT,
        "firstTimestamp": moment,
        "lastTimestamp": moment,
        "count": 1,
    }
