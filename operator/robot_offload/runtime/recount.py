"""Finds what the watches missed, with lists of metadata.

kopf resumes watching after a stream breaks. If the API server has forgotten the events between, kopf lists anew and
delivers the existing objects: it never reports deletions of that time. A silent stream may have lost events as well. So
each kind is counted once more when its stream is reopened, and at each resync: what a list lacks is gone, and what the
watch has not brought is read.
"""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from typing import Final, Protocol, TypeAlias

import structlog

from robot_offload.controller.store import Store, older
from robot_offload.kube.errors import KubeError
from robot_offload.kube.kinds import CONFIG_MAP, SECRET, Kind
from robot_offload.kube.port import KubeApi, Manifest
from robot_offload.runtime.watched import WATCHED, Watched, ours

Place: TypeAlias = str | None
"""A namespace; None: all of them."""
GRACE_S: Final = 1.0
"""What only a list has is read after this time: the watch still delivers most of it."""
_AGAIN_S: Final = 0.2
_PAUSE_S: Final = 2.0
_log = structlog.get_logger("robot_offload.runtime.recount")


class Sink(Protocol):
    """The receiver of what is found."""

    def seen(self, kind: Kind, manifest: Manifest) -> None:
        """Record that an object exists, in this version."""
        ...

    def gone(self, kind: Kind, manifest: Manifest) -> None:
        """Record that an object was deleted; this is its last version."""
        ...

    def only(self, kind: Kind, place: Place, there: frozenset[tuple[str, str]], version: str) -> None:
        """Forget older objects of this place that a list of this version lacks."""
        ...


class Recount:
    """Compares the store with lists.

    Args:
        api: for the lists.
        store: the objects from the watches.
        sink: receives what they missed.
        places: the watched namespaces; empty: all.
        unwatched: a namespace whose Secrets are not watched; None: there is none.

    Attributes:
        complete: set once the store has had every object of the lists.
    """

    def __init__(
        self, api: KubeApi, store: Store, sink: Sink, places: Sequence[str], unwatched: str | None = None
    ) -> None:
        self._api = api
        self._store = store
        self._sink = sink
        self._all = [(watched, place) for watched in WATCHED for place in places or (None,)]
        self._unwatched = unwatched
        self._open: set[tuple[Watched, Place]] = set()
        self._asked: set[tuple[Watched, Place]] = set()
        self._changed = asyncio.Event()
        self.complete = asyncio.Event()

    @property
    def missing(self) -> list[str]:
        """Return the kinds whose watch was never opened."""
        return sorted({watched.kind.kind for watched, place in self._all if (watched, place) not in self._open})

    def opened(self, path: str) -> None:
        """Record that a stream is requested: the list before it has been delivered.

        Args:
            path: the collection's, in the API server.
        """
        for watched, place in self._all:
            if watched.kind.path(place) == path:
                (self._asked if (watched, place) in self._open else self._open).add((watched, place))
                self._changed.set()

    async def run(self, every_s: float) -> None:
        """Count everything at the start and each `every_s` seconds, and a kind when its stream is reopened."""
        await self._first()
        while True:
            self._changed.clear()
            try:
                async with asyncio.timeout(every_s):
                    await self._changed.wait()
            except TimeoutError:
                self._asked.update(self._all)
            due, self._asked = self._asked, set()
            for watched, place in due:
                try:
                    await self._heal(watched, await self._count(watched, place))
                except KubeError as error:
                    _log.warning("Could not recount", kind=watched.kind.kind, error=str(error))
                    self._asked.add((watched, place))
            if self._asked:
                await asyncio.sleep(_PAUSE_S)
                self._changed.set()

    async def look_home(self) -> None:
        """Read the Secrets that are not watched.

        Raises:
            KubeError: the API server refuses or does not answer.
        """
        if self._unwatched is not None:
            secrets = Watched(SECRET)
            for manifest in await self._count(secrets, self._unwatched):
                self._sink.seen(SECRET, manifest)

    async def _first(self) -> None:
        while self.missing:
            self._changed.clear()
            await self._changed.wait()
        left = set(self._all)
        while left:
            for watched, place in tuple(left):
                try:
                    if all(self._knows(watched.kind, late) for late in await self._count(watched, place)):
                        left.discard((watched, place))
                except KubeError as error:
                    _log.warning("Could not count", kind=watched.kind.kind, error=str(error))
                    await asyncio.sleep(_PAUSE_S)
            if left:
                await asyncio.sleep(_AGAIN_S)
        self.complete.set()

    async def _count(self, watched: Watched, place: Place) -> list[Manifest]:
        """Drop what a list lacks; return the metadata of objects that the watch has not brought in this version."""
        kind, there, late, latest = watched.kind, set(), [], ""
        async for page, version in self._api.pages(kind, place, watched.metadata):
            latest = version
            for manifest in page:
                there.add((str(manifest["metadata"].get("namespace") or ""), str(manifest["metadata"]["name"])))
                if not self._current(kind, manifest):
                    late.append(manifest)
            await asyncio.sleep(0)  # passes, probes and renewals continue between two pages
        self._sink.only(kind, place, frozenset(there), latest)
        return late

    async def _heal(self, watched: Watched, late: Sequence[Manifest]) -> None:
        """Read what the watch has still not brought a moment later."""
        if late:
            await asyncio.sleep(GRACE_S)
        for manifest in late:
            kind, metadata = watched.kind, manifest["metadata"]
            if self._current(kind, manifest):
                continue
            _log.info("The watch has missed", kind=kind.kind, namespace=metadata["namespace"], name=metadata["name"])
            if kind == SECRET or self._others(kind, manifest):
                self._sink.seen(kind, manifest)  # for these, only metadata is ever kept
            elif (found := await self._api.get(kind, metadata["namespace"], metadata["name"])) is not None:
                self._sink.seen(kind, found)

    def _current(self, kind: Kind, manifest: Manifest) -> bool:
        """Return whether the store has an object in this version or a newer one, or knows that it was deleted."""
        metadata = manifest["metadata"]
        known = self._version(kind, manifest)
        return self._store.buried(str(metadata["uid"])) or (
            known is not None and not older(known, str(metadata["resourceVersion"]))
        )

    def _knows(self, kind: Kind, manifest: Manifest) -> bool:
        return self._version(kind, manifest) is not None or self._store.buried(str(manifest["metadata"]["uid"]))

    def _version(self, kind: Kind, manifest: Manifest) -> str | None:
        namespace, name = str(manifest["metadata"]["namespace"]), str(manifest["metadata"]["name"])
        if self._others(kind, manifest):
            return self._store.config_versions.get((namespace, name))
        entry = self._store.entry(kind, namespace, name)
        return None if entry is None else entry.version

    @staticmethod
    def _others(kind: Kind, manifest: Manifest) -> bool:
        return kind == CONFIG_MAP and not ours(manifest)
