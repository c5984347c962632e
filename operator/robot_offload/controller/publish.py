"""Writes the status if it differs, and posts its transitions as Events. The only place that does either."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final, TypeAlias

import structlog

from robot_offload.controller.clock import Clock
from robot_offload.controller.memory import Memory, summary
from robot_offload.controller.store import Store
from robot_offload.decide import status, transitions
from robot_offload.kube.errors import InvalidObjectError
from robot_offload.kube.kinds import ROBOT_OFFLOAD
from robot_offload.kube.port import KubeApi, Manifest

COMPONENT: Final = "robot-offload-operator"
Post: TypeAlias = Callable[[Manifest, transitions.Transition], None]
"""Posts an Event about a RobotOffload, in the background. Losing one does not undo a pass."""
_log = structlog.get_logger("robot_offload.controller")


async def publish(
    api: KubeApi, store: Store, raw: Manifest, after: Mapping[str, Any], memory: Memory, clock: Clock, post: Post
) -> int:
    """Write the status if it differs, and post the transitions; return the number of writes."""
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
        post(raw, event)
        posted += 1
    return 1 + posted


async def _write(api: KubeApi, raw: Manifest, change: Mapping[str, Any]) -> Manifest:
    """Write a change of the status. If the API server rejects fields, write the rest."""
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
