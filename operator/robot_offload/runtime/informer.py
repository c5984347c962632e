"""Keeps the store of one kind as the API server has it: a list, then a watch, for ever.

What a list does not have any more is gone, also when the watch was down while it went: nothing stays in the store that
the cluster does not have (decisions/0009 says why kopf's index does not promise that).
"""

from __future__ import annotations

import asyncio
import random
from typing import Final, Protocol

import structlog

from robot_offload.controller.clock import Clock
from robot_offload.kube.errors import ConflictError, KubeError, SilentError
from robot_offload.kube.kinds import Kind
from robot_offload.kube.port import KubeApi, Manifest, Selection

FIRST_PAUSE_S: Final = 0.5
LONGEST_PAUSE_S: Final = 5.0
"""After an outage everything is watched again within this time; fourteen kinds are three requests a second."""
_log = structlog.get_logger("robot_offload.informer")


class Sink(Protocol):
    """Where an informer brings what it learns."""

    def seen(self, kind: Kind, manifest: Manifest) -> None:
        """An object is there, in this version."""
        ...

    def gone(self, kind: Kind, manifest: Manifest) -> None:
        """An object was deleted; this is its last version."""
        ...

    def only(self, kind: Kind, place: str | None, there: frozenset[tuple[str, str]], version: str) -> None:
        """A list of this version has ended: older objects of this place (None: everywhere) that it lacks are gone."""
        ...


class Informer:
    """One kind."""

    def __init__(
        self,
        api: KubeApi,
        kind: Kind,
        sink: Sink,
        selection: Selection,
        *,
        namespace: str | None,
        idle_s: float,
        clock: Clock | None = None,
    ) -> None:
        self._api = api
        self._sink = sink
        self._selection = selection
        self._namespace = namespace
        self._idle_s = idle_s
        self._clock = clock or Clock()
        self.kind = kind
        self.listed = asyncio.Event()
        """Set once the store has everything."""
        self.heard_s = self._clock.steady_s()
        """When the API server last said something, a bookmark for instance."""

    async def run(self) -> None:
        """Lists and watches until cancelled."""
        version, failures = "", 0
        while True:
            try:
                if not version:
                    version = await self._list()
                async for change in self._api.watch(
                    self.kind, self._namespace, self._selection, version, idle_s=self._idle_s
                ):
                    version, failures = change.version, 0
                    self.heard_s = self._clock.steady_s()
                    if change.type == "DELETED":
                        self._sink.gone(self.kind, change.manifest)
                    elif change.type != "BOOKMARK":
                        self._sink.seen(self.kind, change.manifest)
            except SilentError:
                version = ""  # whatever keeps it silent may have swallowed events
            except ConflictError:
                version = ""  # too old: the API server has forgotten what came after it
            except KubeError as error:
                failures += 1
                pause_s = min(LONGEST_PAUSE_S, FIRST_PAUSE_S * 2.0 ** min(failures - 1, 8)) * random.uniform(0.75, 1.25)
                if failures > 1:
                    _log.warning("A watch is down", kind=self.kind.kind, error=str(error), again_s=round(pause_s, 1))
                await asyncio.sleep(pause_s)

    async def _list(self) -> str:
        there: set[tuple[str, str]] = set()
        latest = ""
        async for page, version in self._api.pages(self.kind, self._namespace, self._selection):
            latest = version
            for manifest in page:
                metadata = manifest["metadata"]
                there.add((metadata.get("namespace") or "", metadata["name"]))
                self._sink.seen(self.kind, manifest)
            await asyncio.sleep(0)  # passes, probes and renewals go on between two pages
        self._sink.only(self.kind, self._namespace, frozenset(there), latest)
        self.heard_s = self._clock.steady_s()
        self.listed.set()
        return latest
