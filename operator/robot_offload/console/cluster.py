"""A cluster as a source: the resources, their reporters, and writes, all as the user of the kubeconfig."""

from __future__ import annotations

import asyncio
import contextlib
import datetime
from collections import Counter
from collections.abc import Iterator
from typing import Any, Final

from robot_offload.console import actions
from robot_offload.console.actions import Action, Permission
from robot_offload.console.live import Key
from robot_offload.console.model import Declared, Fleet, Gone, Happened, Trouble
from robot_offload.console.reporters import Reporters
from robot_offload.console.source import Publish
from robot_offload.insight.explanation import event_lines
from robot_offload.insight.observed import observe
from robot_offload.kube.errors import ConflictError, KubeError, NotFoundError, SilentError
from robot_offload.kube.kinds import ACCESS_REVIEW, EVENT, ROBOT_OFFLOAD
from robot_offload.kube.port import KubeApi, Manifest, Selection

AGAIN_S: Final = 1.0
"""Seconds after which a broken watch is retried."""
IDLE_S: Final = 150.0
"""The API server sends a bookmark each minute; a watch that is silent for longer than this is dead."""
EVENTS_S: Final = 10.0
LOOK_S: Final = 1.0
"""How often to check whether a page is open."""
EVENTS: Final = 20
ALL: Final = Selection()


class ClusterSource:
    """What this user may see in the cluster.

    Args:
        api: a connection with the user's identity.
        namespace: to watch; None: all namespaces.
        title: of the pages.
    """

    def __init__(self, api: KubeApi, namespace: str | None, title: str) -> None:
        self._api = api
        self._namespace = namespace
        self._title = title
        self._there: dict[Key, Manifest] = {}
        self._watched: Counter[Key] = Counter()
        self._reporters = Reporters(api, self._there, self._watched)

    def fleet(self) -> Fleet:
        """See `Source.fleet`."""
        return Fleet(self._title)

    async def run(self, publish: Publish) -> None:
        """See `Source.run`."""
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._resources(publish))
            tasks.create_task(self._reporters.run(publish))
            tasks.create_task(self._events(publish))

    @contextlib.contextmanager
    def watching(self, key: Key) -> Iterator[None]:
        """See `Source.watching`."""
        self._watched[key] += 1
        try:
            yield
        finally:
            self._watched[key] -= 1

    async def may(self, key: Key, action: Action) -> Permission:
        """Ask the API server, which knows the user's roles."""
        del action  # every action patches the resource
        attributes = {
            "group": ROBOT_OFFLOAD.group,
            "resource": ROBOT_OFFLOAD.plural,
            "namespace": key.namespace,
            "name": key.name,
            "verb": "patch",
        }
        review = {
            "apiVersion": ACCESS_REVIEW.api_version,
            "kind": ACCESS_REVIEW.kind,
            "metadata": {"name": ""},
            "spec": {"resourceAttributes": attributes},
        }
        status = (await self._api.create(review)).get("status") or {}
        if status.get("allowed"):
            return actions.ALLOWED
        said = f": {status['reason']}" if status.get("reason") else ""
        return Permission(False, f"you may not patch robotoffloads in namespace {key.namespace}{said}")

    async def act(self, key: Key, action: Action) -> str:
        """See `Source.act`."""
        manifest = self._there.get(key)
        if manifest is None:
            raise NotFoundError(f"there is no RobotOffload {key} any more")
        body = actions.patch(action, manifest["metadata"]["uid"], datetime.datetime.now(datetime.UTC))
        return actions.done(action, observe(await self._api.patch(ROBOT_OFFLOAD, key.namespace, key.name, body)))

    # -- resources ----------------------------------------------------------------------------------------------------

    async def _resources(self, publish: Publish) -> None:
        version = ""
        while True:
            try:
                if not version:
                    version = await self._list(publish)
                async for change in self._api.watch(ROBOT_OFFLOAD, self._namespace, ALL, version, idle_s=IDLE_S):
                    version = change.version
                    if change.type == "DELETED":
                        self._gone(_key(change.manifest), publish)
                    elif change.type != "BOOKMARK":
                        self._seen(change.manifest, publish)
            except (ConflictError, SilentError):
                version = ""
            except KubeError as error:
                version = ""
                publish(Trouble(None, f"{error}; what is shown is old, trying again each second"))
                await asyncio.sleep(AGAIN_S)

    async def _list(self, publish: Publish) -> str:
        there: set[Key] = set()
        latest = ""
        async for page, version in self._api.pages(ROBOT_OFFLOAD, self._namespace, ALL):
            latest = version
            for manifest in page:
                there.add(_key(manifest))
                self._seen(manifest, publish)
        for key in set(self._there) - there:
            self._gone(key, publish)
        publish(Trouble(None, ""))
        return latest

    def _seen(self, manifest: Manifest, publish: Publish) -> None:
        key = _key(manifest)
        self._there[key] = manifest
        publish(Declared(key, manifest))

    def _gone(self, key: Key, publish: Publish) -> None:
        self._there.pop(key, None)
        publish(Gone(key))

    # -- beside them --------------------------------------------------------------------------------------------------

    async def _events(self, publish: Publish) -> None:
        """Read the events of robots whose page is open; a user without that right sees none."""
        while True:
            for namespace in {key.namespace for key, count in self._watched.items() if count > 0}:
                with contextlib.suppress(KubeError):
                    found = await self._api.list(EVENT, namespace)
                    now = datetime.datetime.now(datetime.UTC)
                    for key in [key for key in self._there if key.namespace == namespace and self._watched[key] > 0]:
                        types = ("Warning", "Normal")
                        lines = tuple(event_lines(key.name, found, now, types=types, most=EVENTS))
                        publish(Happened(key, lines[::-1]))
            await asyncio.sleep(EVENTS_S if self._watched.total() > 0 else LOOK_S)


def _key(manifest: Manifest) -> Key:
    metadata: dict[str, Any] = manifest["metadata"]
    return Key(str(metadata.get("namespace") or ""), str(metadata["name"]))
