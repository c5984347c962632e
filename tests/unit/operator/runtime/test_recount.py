"""The store has what the cluster has, whatever the watches have missed."""

from __future__ import annotations

import asyncio
from collections import defaultdict
from collections.abc import AsyncIterator, Callable
from contextlib import suppress
from typing import Any, cast

from robot_offload.controller.clock import Clock
from robot_offload.controller.reconcile import Controller
from robot_offload.controller.store import Store
from robot_offload.kube.errors import ServerFailedError
from robot_offload.kube.kinds import CONFIG_MAP, DEPLOYMENT, SECRET, SERVICE, Kind
from robot_offload.kube.port import KubeApi, Manifest, Selection
from robot_offload.objects.facts import default_images
from robot_offload.objects.labels import INSTANCE, MANAGED_BY, MANAGER
from robot_offload.runtime.queue import Queue
from robot_offload.runtime.recount import Place, Recount
from robot_offload.runtime.triggers import Triggers
from robot_offload.runtime.watched import WATCHED


def thing(name: str, version: int, **labels: str) -> Manifest:
    own = labels or {INSTANCE: "walker", MANAGED_BY: MANAGER}
    metadata = {"namespace": "fleet", "name": name, "uid": f"u-{name}", "labels": own}
    return {"metadata": {**metadata, "resourceVersion": str(version)}}


class ServerDouble:
    """Lists what it has, one object a page."""

    def __init__(self) -> None:
        self.there: dict[Kind, list[Manifest]] = defaultdict(list)
        self.version = 100
        self.failures = 0
        self.lists = 0

    async def pages(self, kind: Kind, _: Place, selection: Selection) -> AsyncIterator[tuple[list[Manifest], str]]:
        assert selection.metadata_only
        self.lists += 1
        if self.failures:
            self.failures -= 1
            raise ServerFailedError("down")
        for one in self.there[kind]:
            yield [one], str(self.version)
        yield [], str(self.version)

    async def get(self, kind: Kind, _: str, name: str) -> Manifest | None:
        return next((one for one in self.there[kind] if one["metadata"]["name"] == name), None)


class World:
    """A store, its triggers and a recount."""

    def __init__(self, unwatched: str | None = None) -> None:
        self.api = ServerDouble()
        self.store = Store()
        self.queue: Queue[tuple[str, str]] = Queue(Clock().steady_s)
        api = cast("KubeApi", self.api)
        controller = Controller(api, default_images("1"), store=self.store)
        self.triggers = Triggers(controller, self.store, self.queue)
        self.recount = Recount(api, self.store, self.triggers, (), unwatched)

    def open_all(self) -> None:
        for watched in WATCHED:
            self.recount.opened(watched.kind.path(None))

    def run(self, *steps: Callable[[], Any]) -> None:
        """Runs the recount; after each step it waits until what the step returns becomes true."""

        async def main() -> None:
            running = asyncio.create_task(self.recount.run(3600.0))
            async with asyncio.timeout(60):
                for step in steps:
                    until = step()
                    while not until():
                        await asyncio.sleep(0.01)
            running.cancel()
            with suppress(asyncio.CancelledError):
                await running

        asyncio.run(main())

    def names(self) -> set[str]:
        return {name for _, name in self.store.children("fleet", "walker")}


def test_it_is_complete_once_every_stream_was_opened_and_the_store_has_what_the_lists_have() -> None:
    world = World()
    world.api.there[SERVICE] = [thing("a", 1), thing("b", 1)]
    assert "Service" in world.recount.missing

    def one_is_late() -> Callable[[], object]:
        world.triggers.seen(SERVICE, thing("a", 1))
        world.open_all()
        return lambda: world.api.lists > len(WATCHED)

    def the_other_comes() -> Callable[[], object]:
        assert not world.recount.complete.is_set()
        world.triggers.seen(SERVICE, thing("b", 1))
        return world.recount.complete.is_set

    world.run(one_is_late, the_other_comes)
    assert world.recount.missing == []


def test_what_went_while_the_watch_was_down_is_gone_and_wakes_its_owner() -> None:
    world = World()
    world.triggers.seen(SERVICE, thing("a", 1))
    world.triggers.seen(SERVICE, thing("b", 1))
    world.api.there[SERVICE] = [thing("a", 1)]

    def start() -> Callable[[], object]:
        world.open_all()
        return world.recount.complete.is_set

    world.run(start)
    assert world.names() == {"a"}


def test_a_stream_that_is_opened_again_is_counted_again_and_what_it_missed_is_read() -> None:
    world = World()

    def start() -> Callable[[], object]:
        world.open_all()
        return world.recount.complete.is_set

    def again() -> Callable[[], object]:
        world.api.there[DEPLOYMENT] = [thing("a", 7)]
        world.recount.opened(DEPLOYMENT.path(None))
        return lambda: world.names() == {"a"}

    world.run(start, again)


def test_a_list_that_fails_is_asked_for_again() -> None:
    world = World()

    def start() -> Callable[[], object]:
        world.open_all()
        return world.recount.complete.is_set

    world.api.failures = 1
    world.run(start)


def test_keys_of_certificates_are_not_read_and_users_config_maps_are_known_by_their_version() -> None:
    world = World()
    theirs = thing("tuning", 5, app="theirs")

    def start() -> Callable[[], object]:
        world.open_all()
        return world.recount.complete.is_set

    def again() -> Callable[[], object]:
        world.api.there[SECRET] = [thing("walker-robot", 7)]
        world.api.there[CONFIG_MAP] = [theirs]
        world.recount.opened(SECRET.path(None))
        world.recount.opened(CONFIG_MAP.path(None))
        return lambda: world.names() == {"walker-robot"} and world.store.config_versions

    def gone() -> Callable[[], object]:
        world.api.there[CONFIG_MAP] = []
        world.recount.opened(CONFIG_MAP.path(None))
        return lambda: not world.store.config_versions

    world.run(start, again, gone)


def test_secrets_beside_the_operator_are_taken_in_where_no_watch_brings_them() -> None:
    world = World("fleet")
    world.api.there[SECRET] = [thing("client-ca", 7)]
    asyncio.run(world.recount.look_home())
    assert world.names() == {"client-ca"}
    world.api.there[SECRET] = []
    asyncio.run(world.recount.look_home())
    assert world.names() == set()
