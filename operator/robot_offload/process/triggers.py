"""The table of triggers: which event in the cluster leads to a pass over which RobotOffload.

Nothing else imports kopf.

Events are all that kopf is used for. Its timers, daemons and change handlers would write annotations or finalizers onto
objects; ours are never written by it.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Mapping, Sequence
from typing import Any, Final, Protocol

import kopf

from robot_offload.kube.kinds import CHILD_KINDS, CONFIG_MAP, LEASE, POD, ROBOT_OFFLOAD, Kind
from robot_offload.kube.port import Manifest
from robot_offload.objects import labels

OWN: Final = "robotoffload.dev"
OURS: Final = f"{labels.MANAGED_BY}={labels.MANAGER}"
# For kopf's peering, which is off. Without one kopf asks for the name of the user, and the user id of a pod has none.
_IDENTITY: Final[Any] = "robot-offload"
_CHILDREN: Final = tuple(kind for kind in CHILD_KINDS if kind not in (CONFIG_MAP, LEASE))


class Triggers(Protocol):
    """What events are made into."""

    def resource(self, manifest: Manifest, *, gone: bool) -> None:
        """A RobotOffload has changed."""
        ...

    def child(self, manifest: Manifest, *, gone: bool) -> None:
        """An object with our labels has changed."""
        ...

    def lease(self, manifest: Manifest, *, gone: bool) -> None:
        """A robot's Lease has changed."""
        ...

    def config_map(self, manifest: Manifest, *, gone: bool) -> None:
        """A ConfigMap has changed: one of ours, or one that a user's nodes read."""
        ...


def table(triggers: Triggers) -> kopf.OperatorRegistry:
    """The triggers, registered."""
    registry = kopf.OperatorRegistry()

    @kopf.on.login(registry=registry)
    def login(**given: Any) -> kopf.ConnectionInfo | None:
        # Only these two: the others would import the whole synchronous client.
        return kopf.login_with_kubeconfig(**given) or kopf.login_with_service_account(**given)

    @kopf.on.event(*_names(ROBOT_OFFLOAD), registry=registry, id="resource")
    async def resource(body: kopf.Body, type: str | None, **_: Any) -> None:  # noqa: A002
        triggers.resource(_manifest(ROBOT_OFFLOAD, body), gone=type == "DELETED")

    @kopf.on.event(*_names(CONFIG_MAP), registry=registry, id="config-map")
    async def config_map(body: kopf.Body, type: str | None, **_: Any) -> None:  # noqa: A002
        triggers.config_map(_manifest(CONFIG_MAP, body), gone=type == "DELETED")

    @kopf.on.event(*_names(LEASE), registry=registry, id="lease")
    async def lease(body: kopf.Body, type: str | None, **_: Any) -> None:  # noqa: A002
        triggers.lease(_manifest(LEASE, body), gone=type == "DELETED")

    async def child(body: kopf.Body, type: str | None, param: Any = None, **_: Any) -> None:  # noqa: A002
        triggers.child(_manifest(param, body), gone=type == "DELETED")

    for kind in (*_CHILDREN, POD):
        kopf.on.event(*_names(kind), registry=registry, id=kind.plural, param=kind)(child)
    return registry


def settings(inactivity_s: float) -> kopf.OperatorSettings:
    """The settings of kopf, all that matter owned by us.

    Args:
        inactivity_s: seconds after which a silent watch is opened again; API servers send a bookmark each minute.
    """
    own = kopf.OperatorSettings()
    own.persistence.finalizer = f"{OWN}/finalizer"
    own.persistence.progress_storage = kopf.AnnotationsProgressStorage(prefix=OWN)
    own.persistence.diffbase_storage = kopf.AnnotationsDiffBaseStorage(prefix=OWN)
    own.posting.enabled = False
    own.scanning.disabled = True
    own.networking.request_timeout = 30.0
    own.networking.connect_timeout = 10.0
    own.networking.enforce_retry_after = True
    own.watching.server_timeout = 600
    own.watching.connect_timeout = 10.0
    own.watching.inactivity_timeout = inactivity_s
    own.watching.reconnect_backoff = 1.0
    own.watching.chunk_size = 200
    own.queueing.idle_timeout = 1.0
    own.queueing.exit_timeout = 1.0
    own.process.ultimate_exiting_timeout = 25.0
    for kind in (*_CHILDREN, LEASE, POD):
        own.watching.label_selectors[kind.group, kind.plural] = OURS
    # Users' ConfigMaps carry no label of ours; the one that every namespace has is the only one that is never read.
    own.watching.field_selectors[CONFIG_MAP.group, CONFIG_MAP.plural] = "metadata.name!=kube-root-ca.crt"
    return own


def operator(
    triggers: Triggers, *, namespaces: Sequence[str], inactivity_s: float, ready: asyncio.Event, stop: asyncio.Event
) -> Awaitable[None]:
    """Watches until `stop` is set, a signal comes or something breaks.

    Args:
        triggers: what events are made into.
        namespaces: those to watch; empty: all.
        inactivity_s: see `settings`.
        ready: set when watching begins.
        stop: ends it.
    """
    places: Mapping[str, Any] = {"namespaces": list(namespaces)} if namespaces else {"clusterwide": True}
    return kopf.operator(
        registry=table(triggers),
        settings=settings(inactivity_s),
        standalone=True,
        identity=_IDENTITY,
        ready_flag=ready,
        stop_flag=stop,
        **places,
    )


def _names(kind: Kind) -> tuple[str, str, str]:
    group, _, version = kind.api_version.rpartition("/")
    return group, version, kind.plural


def _manifest(kind: Kind, body: kopf.Body) -> Manifest:
    """The object of an event as a manifest; objects from a list lack apiVersion and kind."""
    return {**body, "apiVersion": kind.api_version, "kind": kind.kind}
