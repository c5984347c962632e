"""What the watches have missed, found by lists of metadata.

kopf goes on watching after whatever has broken off a stream. Where the API server has forgotten what came in between,
kopf lists anew and delivers what is there: what was deleted meanwhile it never reports. A stream that was silent may
have swallowed events as well. So each kind is counted once more when its stream is opened again, and at each resync:
what a list does not have is gone, and what the watch has not brought is read.
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
"""What a list has and the watch has not brought is read after this time: most of it is on its way."""
_AGAIN_S: Final = 0.2
_PAUSE_S: Final = 2.0
_log = structlog.get_logger("robot_offload.runtime.recount")


class Sink(Protocol):
    """Where is brought what is learnt."""

    def seen(self, kind: Kind, manifest: Manifest) -> None:
        """Note that an object is there, in this version."""
        ...

    def gone(self, kind: Kind, manifest: Manifest) -> None:
        """Note that an object was deleted; this is its last version."""
        ...

    def only(self, kind: Kind, place: Place, there: frozenset[tuple[str, str]], version: str) -> None:
        """Forget older objects of this place that a list of this version lacks."""
        ...


class Recount:
    """Compares the store with lists.

    Args:
        api: is asked for lists.
        store: what the watches have brought.
        sink: where is brought what they have missed.
        places: the namespaces that are watched; empty: all.
        unwatched: a namespace whose Secrets no watch brings; None: there is none.

    Attributes:
        complete: set once the store has had every object that the lists have.
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
        """Return the kinds whose watch has never been opened."""
        return sorted({watched.kind.kind for watched, place in self._all if (watched, place) not in self._open})

    def opened(self, path: str) -> None:
        """Note that a stream is asked for: what was listed before it has been handed over.

        Args:
            path: of the collection in the API server.
        """
        for watched, place in self._all:
            if watched.kind.path(place) == path:
                (self._asked if (watched, place) in self._open else self._open).add((watched, place))
                self._changed.set()

    async def run(self, every_s: float) -> None:
        """Count everything at the start and each `every_s` seconds, and a kind when its stream is opened again."""
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
        """Take in the Secrets that no watch brings.

        Raises:
            KubeError: the API server refuses or is silent.
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
        """Drop what a list does not have; return the metadata of what the watch has not brought in this version."""
        kind, there, late, latest = watched.kind, set(), [], ""
        async for page, version in self._api.pages(kind, place, watched.metadata):
            latest = version
            for manifest in page:
                there.add((str(manifest["metadata"].get("namespace") or ""), str(manifest["metadata"]["name"])))
                if not self._current(kind, manifest):
                    late.append(manifest)
            await asyncio.sleep(0)  # passes, probes and renewals go on between two pages
        self._sink.only(kind, place, frozenset(there), latest)
        return late

    async def _heal(self, watched: Watched, late: Sequence[Manifest]) -> None:
        """Read what the watch has still not brought after a moment."""
        if late:
            await asyncio.sleep(GRACE_S)
        for manifest in late:
            kind, metadata = watched.kind, manifest["metadata"]
            if self._current(kind, manifest):
                continue
            _log.info("The watch has missed", kind=kind.kind, namespace=metadata["namespace"], name=metadata["name"])
            if kind == SECRET or self._others(kind, manifest):
                self._sink.seen(kind, manifest)  # more than metadata is never kept of these
            elif (found := await self._api.get(kind, metadata["namespace"], metadata["name"])) is not None:
                self._sink.seen(kind, found)

    def _current(self, kind: Kind, manifest: Manifest) -> bool:
        """Return whether the store has an object in this version or a newer one, or know that it has gone."""
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
