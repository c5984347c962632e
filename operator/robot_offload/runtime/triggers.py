"""The table of triggers: which event in the cluster leads to a pass over which RobotOffload, and what is watched.

Events bring the store up to date first. What a pass has written itself is in the store already when its event comes, so
the echo of our own writes leads to nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

from robot_offload.controller.clock import Clock
from robot_offload.controller.reconcile import Controller, Name
from robot_offload.controller.store import Store
from robot_offload.decide import authorities
from robot_offload.kube.kinds import CHILD_KINDS, CONFIG_MAP, LEASE, POD, ROBOT_OFFLOAD, SECRET, Kind
from robot_offload.kube.port import KubeApi, Manifest, Selection
from robot_offload.objects import labels
from robot_offload.runtime.health import WatchSight
from robot_offload.runtime.informer import Informer, Sink
from robot_offload.runtime.queue import Queue

SETTLE_S: Final = 0.1
"""Seconds for which the pass after an event of a child waits for its siblings' events."""
_OURS: Final = f"{labels.MANAGED_BY}={labels.MANAGER}"
_OTHERS: Final = Selection(f"{labels.MANAGED_BY}!={labels.MANAGER}", "metadata.name!=kube-root-ca.crt", True)


class Triggers:
    """Takes in events of RobotOffloads, their children and their pods (see `informer.Sink`)."""

    def __init__(
        self,
        controller: Controller,
        store: Store,
        queue: Queue[Name],
        sight: WatchSight,
        gone: Callable[[], None] = lambda: None,
    ) -> None:
        self._controller = controller
        self._store = store
        self._queue = queue
        self._sight = sight
        self._gone = gone

    def seen(self, kind: Kind, manifest: Manifest) -> None:
        """See `Sink.seen`."""
        if kind == ROBOT_OFFLOAD:
            self._resource(manifest)
            return
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

    def gone(self, kind: Kind, manifest: Manifest) -> None:
        """See `Sink.gone`."""
        metadata = manifest["metadata"]
        self._store.drop(kind, metadata["namespace"], metadata["name"], metadata["uid"])
        if kind == ROBOT_OFFLOAD:
            self._sight.delivered(manifest, gone=True)
            self._gone()
            self._queue.add((metadata["namespace"], metadata["name"]))
        elif (name := owner(manifest)) is not None:
            self._queue.add(name, SETTLE_S)

    def only(self, kind: Kind, place: str | None, there: frozenset[tuple[str, str]], version: str) -> None:
        """See `Sink.only`."""
        for namespace, instance in self._store.prune(kind, place, there, version):
            if instance:
                self._queue.add((namespace, instance), SETTLE_S)

    def _resource(self, manifest: Manifest) -> None:
        self._sight.delivered(manifest)
        metadata = manifest["metadata"]
        name = metadata["namespace"], metadata["name"]
        before = self._store.entry(ROBOT_OFFLOAD, *name)
        if self._store.put(ROBOT_OFFLOAD, manifest):
            # What a person has just written goes first; what is found at the start is all equally old.
            changed = before is None or before.generation != metadata.get("generation")
            self._queue.add(name, urgent=self._store.fed and changed)


class OthersConfigMaps:
    """Takes in events of ConfigMaps that are not ours: nodes may read them. Only their versions are kept."""

    def __init__(self, controller: Controller, store: Store, queue: Queue[Name]) -> None:
        self._controller = controller
        self._store = store
        self._queue = queue

    def seen(self, kind: Kind, manifest: Manifest) -> None:
        """See `Sink.seen`."""
        metadata = manifest["metadata"]
        self._note((metadata["namespace"], metadata["name"]), str(metadata["resourceVersion"]))

    def gone(self, kind: Kind, manifest: Manifest) -> None:
        """See `Sink.gone`."""
        self._note((manifest["metadata"]["namespace"], manifest["metadata"]["name"]), "")

    def only(self, kind: Kind, place: str | None, there: frozenset[tuple[str, str]], version: str) -> None:
        """See `Sink.only`."""
        for known in set(self._store.config_versions) - there:
            if place in (None, known[0]):
                self._note(known, "")

    def _note(self, place: tuple[str, str], version: str) -> None:
        if self._store.config_versions.get(place, "") == version:
            return
        if version:
            self._store.config_versions[place] = version
        else:
            del self._store.config_versions[place]
        for name in self._controller.readers(*place):
            self._queue.add(name, SETTLE_S)


def informers(
    api: KubeApi,
    triggers: Triggers,
    others: OthersConfigMaps,
    *,
    namespaces: Sequence[str],
    home: str,
    idle_s: float,
    clock: Clock,
) -> list[Informer]:
    """Returns one informer for each kind that leads to passes, and for each namespace.

    Args:
        api: reads the cluster.
        triggers: what becomes of events of our own kinds.
        others: what becomes of events of other ConfigMaps.
        namespaces: those to watch; empty: all.
        home: the operator's own namespace, where the keys of authorities are.
        idle_s: seconds after which a silent watch is opened again; API servers send a bookmark each minute.
        clock: both clocks.
    """
    # Keys of certificates are none of the store's business.
    kinds = [(kind, Selection(_OURS, metadata_only=kind == SECRET)) for kind in (*CHILD_KINDS, POD)]
    found: list[Informer] = []
    if namespaces and home not in namespaces:
        secrets = Selection(_OURS, metadata_only=True)
        found.append(Informer(api, SECRET, triggers, secrets, namespace=home, idle_s=idle_s, clock=clock))
    for place in namespaces or (None,):
        sinks: list[tuple[Kind, Selection, Sink]] = [
            (ROBOT_OFFLOAD, Selection(), triggers),
            *((kind, selection, triggers) for kind, selection in kinds),
            (CONFIG_MAP, _OTHERS, others),
        ]
        found += [
            Informer(api, kind, sink, selection, namespace=place, idle_s=idle_s, clock=clock)
            for kind, selection, sink in sinks
        ]
    return found


def owner(manifest: Manifest) -> Name | None:
    """Returns the RobotOffload that an object belongs to by its label, or that an authority's Secret serves."""
    metadata = manifest["metadata"]
    served = authorities.serves(manifest)
    if served is not None:
        return served
    instance = (metadata.get("labels") or {}).get(labels.INSTANCE)
    return (metadata["namespace"], instance) if instance and metadata.get("namespace") else None
