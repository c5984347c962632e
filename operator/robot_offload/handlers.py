"""The operator's table of contents: the handlers that kopf calls, and when.

kopf provides the process and its signals, the watches and their reconnection, serial handling for each object, the
credentials and the posting of Events. Handlers put the news into the store and wake the RobotOffload concerned; the
queue makes one pass at a time over each (`controller/reconcile`), as often as time and failures require. Timers and
daemons of kopf need a finalizer, and change handlers need annotations on users' objects: none of them is used
(docs/decisions/0026-kopf.md).
"""

from __future__ import annotations

import contextvars
import sys
from collections.abc import Iterator
from typing import Any, Final

import kopf

from robot_offload.controller.publish import COMPONENT
from robot_offload.kube.kinds import ROBOT_OFFLOAD, Kind
from robot_offload.runtime import process
from robot_offload.runtime.operator import Operator
from robot_offload.runtime.settings import Settings
from robot_offload.runtime.storage import NoDifference, NoProgress
from robot_offload.runtime.watched import WATCHED

REGISTRY: Final = kopf.OperatorRegistry()
_CHILDREN: Final = {
    (watched.kind.group, watched.kind.plural): watched.kind for watched in WATCHED if watched.kind != ROBOT_OFFLOAD
}
_LONGEST_WAIT_S: Final = 5.0
_PAGE: Final = 500
"""Objects per page of a list: bounds the memory of one answer."""


class Patience:
    """Endless pauses in seconds between attempts of kopf's requests: a failing watch may work later."""

    def __iter__(self) -> Iterator[float]:
        """Yield growing pauses."""
        pause_s = 0.5
        while True:
            yield pause_s
            pause_s = min(_LONGEST_WAIT_S, 2 * pause_s)


# -- the process ------------------------------------------------------------------------------------------------------


@kopf.on.startup(registry=REGISTRY)
async def start(settings: kopf.OperatorSettings, memo: Operator, retry: int, **_: Any) -> None:
    """Answer probes at once, wait for the API server and the kind RobotOffload, then count and compete to lead."""
    if retry == 0:
        configure(settings, memo.settings)
        await memo.serve()
    if obstacle := await memo.obstacle():
        raise kopf.TemporaryError(obstacle, delay=min(_LONGEST_WAIT_S, 1.0 + retry))
    memo.begin()


@kopf.on.login(registry=REGISTRY)
async def log_in(memo: Operator, **_: Any) -> kopf.AiohttpSession:
    """Read the credentials, at the start and whenever the API server no longer accepts them."""
    return await memo.log_in()


@kopf.on.cleanup(registry=REGISTRY)
async def end(memo: Operator, **_: Any) -> None:
    """Stop what was started, and release the leader's Lease."""
    await memo.end()


# -- what is watched --------------------------------------------------------------------------------------------------


@kopf.on.event(ROBOT_OFFLOAD.api_version, ROBOT_OFFLOAD.plural, registry=REGISTRY)
async def robot_offload(event: kopf.RawEvent, memo: Operator, **_: Any) -> None:
    """Wake the RobotOffload that was created, changed or deleted; a person's change goes first."""
    memo.context = memo.context or contextvars.copy_context()
    memo.sight.delivered(dict(event["object"]), gone=event["type"] == "DELETED")
    bring(ROBOT_OFFLOAD, event, memo)


async def child(event: kopf.RawEvent, resource: kopf.Resource, memo: Operator, **_: Any) -> None:
    """Wake the owner of a child, of its pod or of the robot's Lease, or the readers of a user's ConfigMap."""
    bring(_CHILDREN[resource.group, resource.plural], event, memo)


for _kind in _CHILDREN.values():
    kopf.on.event(_kind.api_version, _kind.plural, registry=REGISTRY)(child)


def bring(kind: Kind, event: kopf.RawEvent, memo: Operator) -> None:
    """Put an object of the watch into the store, and pass it on to its waiters."""
    # Items of a list carry no kind, and Secrets that of their metadata.
    manifest = {**event["object"], "apiVersion": kind.api_version, "kind": kind.kind}
    if event["type"] == "DELETED":
        memo.triggers.gone(kind, manifest)
    else:
        memo.triggers.seen(kind, manifest)


def configure(settings: kopf.OperatorSettings, ours: Settings) -> None:
    """Configure kopf's watches and patience, and that it leaves nothing on any object."""
    settings.persistence.progress_storage = NoProgress()
    settings.persistence.diffbase_storage = NoDifference()
    settings.persistence.finalizer = "robotoffload.dev/unused"
    settings.scanning.disabled = True
    settings.watching.inactivity_timeout = ours.inactivity_s
    settings.watching.connect_timeout = ours.request_s
    settings.watching.chunk_size = _PAGE
    for watched in WATCHED:
        resource = watched.kind.api_version, watched.kind.plural
        if watched.labels:
            settings.watching.label_selectors[resource] = watched.labels
        if watched.fields:
            settings.watching.field_selectors[resource] = watched.fields
    settings.queueing.idle_timeout = 0.1  # a waiting worker holds the last object it has seen
    settings.networking.request_timeout = ours.request_s
    settings.networking.error_backoffs = Patience()
    settings.posting.reporting_component = COMPONENT
    settings.posting.reporting_instance = ours.pod_name
    settings.posting.event_name_prefix = "robot-offload-"


def main() -> int:
    """Run the operator; return the exit code of the process."""
    return process.run(REGISTRY)


if __name__ == "__main__":
    sys.exit(main())
