"""Deletes the keys of authorities whose RobotOffload has long been gone: no owner reference reaches them.

They outlive it for a time, so that an object that is deleted and applied again, restored or moved still has them
(`decide.authorities`).

A key deleted too early invalidates every bundle, so the API server itself is asked first, by a list: if the kind is
not served at all (404 as well), nothing is deleted.
"""

from __future__ import annotations

import asyncio
import datetime
from collections.abc import Collection

import structlog

from robot_offload.controller.clock import Clock
from robot_offload.controller.store import Entry, Store
from robot_offload.decide import authorities
from robot_offload.decide.conditions import timestamp
from robot_offload.decide.ownership import APPLIED, being_deleted
from robot_offload.kube.errors import KubeError
from robot_offload.kube.kinds import ROBOT_OFFLOAD, SECRET
from robot_offload.kube.port import KubeApi, Manifest, Selection

_SETTLE_S = 1.0
"""How long a sweep waits for further RobotOffloads to be deleted."""
_log = structlog.get_logger("robot_offload.runtime.collector")


class Collector:
    """Sweeps the operator's own namespace.

    Args:
        api: lists and deletes.
        store: the objects from the watches.
        served: namespaces whose RobotOffloads this operator serves; empty: all.
        home: the operator's own namespace.
        keep: how long keys outlive their RobotOffload.
        clock: its wall clock counts.
    """

    def __init__(
        self,
        api: KubeApi,
        store: Store,
        served: Collection[str],
        home: str,
        keep: datetime.timedelta = authorities.KEEP,
        clock: Clock | None = None,
    ) -> None:
        self._api = api
        self._store = store
        self._served = served
        self._home = home
        self._keep = keep
        self._clock = clock or Clock()
        self._asked = asyncio.Event()
        self._asked.set()  # something may have gone while no operator ran

    def wake(self) -> None:
        """Request a sweep soon: a RobotOffload was deleted."""
        self._asked.set()

    async def run(self, every_s: float) -> None:
        """Sweep at the start, on request, and each `every_s` seconds, until cancelled."""
        while True:
            try:
                async with asyncio.timeout(every_s):
                    await self._asked.wait()
            except TimeoutError:
                pass
            await asyncio.sleep(min(_SETTLE_S, every_s))
            if not self._store.fed:
                continue
            self._asked.clear()
            try:
                await self.sweep()
            except KubeError as error:
                _log.warning("Could not collect what is left of gone RobotOffloads", error=str(error))

    async def sweep(self) -> int:
        """Delete the Secrets of RobotOffloads that have long been gone; return their number.

        Raises:
            KubeError: the API server refuses or does not answer.
        """
        alive, now = self._store.uids(ROBOT_OFFLOAD), self._clock.wall()
        gone: list[Manifest] = []
        for name, entry in self._store.entries(SECRET, self._home):
            uid = authorities.uid_of(name)
            if uid and uid not in alive and await self._gone(entry, uid):
                gone.append(await self._marked(entry.manifest(), now))
        expired = authorities.expired(gone, self._keep, now)
        for secret in expired:
            place = authorities.serves(secret)
            _log.info(
                "Deletes the keys of a RobotOffload that is gone", serves=place, secret=secret["metadata"]["name"]
            )
            await self._api.delete(SECRET, self._home, secret["metadata"]["name"], secret["metadata"]["uid"])
        return len(expired)

    async def _marked(self, secret: Manifest, now: datetime.datetime) -> Manifest:
        """Return the Secret of a deleted RobotOffload with the time of the deletion, which is stored on it."""
        metadata = secret["metadata"]
        annotations = metadata.get("annotations") or {}
        if authorities.ORPHANED in annotations:
            return secret
        since = {authorities.ORPHANED: timestamp(now)}
        if self._keep:
            body = {"metadata": {"uid": metadata["uid"], "annotations": since}}
            await self._api.patch(SECRET, self._home, metadata["name"], body)
        return {**secret, "metadata": {**metadata, "annotations": {**annotations, **since}}}

    async def _gone(self, entry: Entry, uid: str) -> bool:
        secret = entry.manifest()
        served = authorities.serves(secret)
        applied = str((secret["metadata"].get("annotations") or {}).get(APPLIED, ""))
        if served is None or applied.partition("/")[0] != uid or being_deleted(secret):
            return False  # not ours
        if self._served and served[0] not in self._served:
            return False  # another operator's, or one that may be served again
        selection = Selection(fields=f"metadata.name={served[1]}", metadata_only=True)
        async for page, _ in self._api.pages(ROBOT_OFFLOAD, served[0], selection):
            if any(found["metadata"]["uid"] == uid for found in page):
                return False
        return True
