"""Which event in the cluster leads to a pass over which RobotOffload.

An event updates the store first. A pass's own writes are already in the store when their events come, so the echo of
our own writes leads to nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from robot_offload.controller.reconcile import Controller, Name
from robot_offload.controller.store import Store
from robot_offload.decide import authorities
from robot_offload.kube.kinds import CONFIG_MAP, LEASE, ROBOT_OFFLOAD, Kind
from robot_offload.kube.port import Manifest
from robot_offload.objects import labels
from robot_offload.runtime.queue import Queue
from robot_offload.runtime.recount import Place
from robot_offload.runtime.watched import ours

SETTLE_S: Final = 0.1
"""How long the pass after an event of a child waits for its siblings' events, in seconds."""


class Triggers:
    """Receives what the watches and the recount find (see `recount.Sink`)."""

    def __init__(
        self, controller: Controller, store: Store, queue: Queue[Name], gone: Callable[[], None] = lambda: None
    ) -> None:
        """Create the triggers; `gone` is called when a RobotOffload was deleted."""
        self._controller = controller
        self._store = store
        self._queue = queue
        self._gone = gone

    def seen(self, kind: Kind, manifest: Manifest) -> None:
        """See `Sink.seen`."""
        if kind == ROBOT_OFFLOAD:
            self._resource(manifest)
        elif kind == CONFIG_MAP and not ours(manifest):
            self._config_map(_place(manifest), str(manifest["metadata"]["resourceVersion"]))
        else:
            self._child(kind, manifest)

    def gone(self, kind: Kind, manifest: Manifest) -> None:
        """See `Sink.gone`."""
        place = _place(manifest)
        if kind == CONFIG_MAP and not ours(manifest):
            self._config_map(place, "")
            return
        self._store.drop(kind, *place, manifest["metadata"]["uid"])
        if kind == ROBOT_OFFLOAD:
            self._gone()
            self._queue.add(place)
        elif (name := owner(manifest)) is not None:
            self._queue.add(name, SETTLE_S)

    def only(self, kind: Kind, place: Place, there: frozenset[tuple[str, str]], version: str) -> None:
        """See `Sink.only`."""
        for namespace, instance in self._store.prune(kind, place, there, version):
            if kind == ROBOT_OFFLOAD:
                self._gone()
            if instance:
                self._queue.add((namespace, instance), SETTLE_S)
        if kind == CONFIG_MAP:
            for known in set(self._store.config_versions) - there:
                if place in (None, known[0]):
                    self._config_map(known, "")

    def _resource(self, manifest: Manifest) -> None:
        name = _place(manifest)
        before = self._store.entry(ROBOT_OFFLOAD, *name)
        if self._store.put(ROBOT_OFFLOAD, manifest):
            # A person's latest change goes first; objects found at the start are all equally old.
            changed = before is None or before.generation != manifest["metadata"].get("generation")
            self._queue.add(name, urgent=self._store.fed and changed)

    def _child(self, kind: Kind, manifest: Manifest) -> None:
        news = self._store.put(kind, manifest)
        name = owner(manifest)
        if name is None:
            return
        if kind == LEASE:
            settled_s = self._controller.saw_lease(name, manifest)
            if settled_s is not None:
                self._queue.postpone(name, settled_s)  # renewing alone needs no pass
                return
        if news:
            self._queue.add(name, 0.0 if kind == LEASE else SETTLE_S)

    def _config_map(self, place: tuple[str, str], version: str) -> None:
        """Record the version of a user's ConfigMap (empty: deleted). Nodes may read it; its content is not kept."""
        if self._store.config_versions.get(place, "") == version:
            return
        if version:
            self._store.config_versions[place] = version
        else:
            del self._store.config_versions[place]
        for name in self._controller.readers(*place):
            self._queue.add(name, SETTLE_S)


def owner(manifest: Manifest) -> Name | None:
    """Return the RobotOffload of an object's label, or the one that an authority's Secret serves."""
    metadata = manifest["metadata"]
    served = authorities.serves(manifest)
    if served is not None:
        return served
    instance = (metadata.get("labels") or {}).get(labels.INSTANCE)
    return (metadata["namespace"], instance) if instance and metadata.get("namespace") else None


def _place(manifest: Manifest) -> tuple[str, str]:
    return str(manifest["metadata"]["namespace"]), str(manifest["metadata"]["name"])
