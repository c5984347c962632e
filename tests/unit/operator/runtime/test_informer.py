"""The store has what the cluster has, whatever happens to the watches."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from typing import Any

from robot_offload.controller.store import Store
from robot_offload.kube.errors import ConflictError, ServerFailedError, SilentError
from robot_offload.kube.kinds import CONFIG_MAP, SECRET, Kind
from robot_offload.kube.port import Change, Manifest, Selection
from robot_offload.runtime.informer import Informer


def config(name: str, version: int, uid: str = "", **data: str) -> Manifest:
    labels = {"app.kubernetes.io/instance": "walker"}
    metadata = {"namespace": "fleet", "name": name, "uid": uid or f"u-{name}", "labels": labels}
    return {"metadata": {**metadata, "resourceVersion": str(version)}, "data": data}


class Server:
    """Answers lists with what it has, and watches with a script: changes, and errors that end the watch."""

    def __init__(self, *scripts: Sequence[Change | Exception]) -> None:
        self.there: list[Manifest] = []
        self.version = 1
        self.scripts = list(scripts)
        self.watched_from: list[str] = []

    async def pages(self, *_: Any) -> AsyncIterator[tuple[list[Manifest], str]]:
        yield self.there[:1], str(self.version)
        yield self.there[1:], str(self.version)

    async def watch(self, _: Kind, __: None, ___: Selection, version: str, *, idle_s: float) -> AsyncIterator[Change]:
        self.watched_from.append(version)
        for step in self.scripts.pop(0) if self.scripts else ():
            if isinstance(step, Exception):
                raise step
            yield step
        if not self.scripts:
            await asyncio.sleep(3600)


class Kept:
    """A sink that keeps a store."""

    def __init__(self) -> None:
        self.store = Store()

    def seen(self, kind: Kind, manifest: Manifest) -> None:
        self.store.put(kind, manifest)

    def gone(self, kind: Kind, manifest: Manifest) -> None:
        metadata = manifest["metadata"]
        self.store.drop(kind, metadata["namespace"], metadata["name"], metadata["uid"])

    def only(self, kind: Kind, place: str | None, there: frozenset[tuple[str, str]], version: str) -> None:
        self.store.prune(kind, place, there, version)

    @property
    def names(self) -> set[str]:
        return {name for _, name in self.store.children("fleet", "walker")}


def run(server: Server, until: Callable[[Kept], bool]) -> Kept:
    async def main() -> Kept:
        kept = Kept()
        informer = Informer(server, CONFIG_MAP, kept, Selection(), namespace=None, idle_s=1)  # type: ignore[arg-type]
        running: Awaitable[None] = asyncio.create_task(informer.run())
        async with asyncio.timeout(60):
            while not (informer.listed.is_set() and until(kept) and not server.scripts):
                await asyncio.sleep(0.01)
        running.cancel()  # type: ignore[attr-defined]
        return kept

    return asyncio.run(main())


def changed(type_: str, manifest: Manifest) -> Change:
    return Change(type_, manifest, manifest["metadata"]["resourceVersion"])


def test_a_list_and_what_happens_after_it() -> None:
    server = Server(
        [changed("ADDED", config("c", 5)), changed("DELETED", config("a", 6)), changed("BOOKMARK", config("", 9))], []
    )
    server.there = [config("a", 1), config("b", 1)]
    kept = run(server, lambda kept: kept.names == {"b", "c"})
    assert kept.names == {"b", "c"}
    assert server.watched_from == ["1", "9"]


def test_what_went_while_the_watch_was_down_is_gone_from_the_store() -> None:
    class Shrinking(Server):
        async def watch(self, *given: Any, **named: Any) -> AsyncIterator[Change]:
            self.there, self.version = [config("b", 1)], 20
            async for change in super().watch(*given, **named):
                yield change

    for trouble in (ConflictError("too old"), SilentError("silent")):
        server = Shrinking([trouble], [])
        server.there = [config("a", 1), config("b", 1)]
        assert run(server, lambda kept: kept.names == {"b"}).names == {"b"}
        assert server.watched_from == ["1", "20"]


def test_a_watch_that_fails_goes_on_where_it_was() -> None:
    server = Server(
        [changed("ADDED", config("c", 5)), ServerFailedError("down")], [changed("ADDED", config("d", 6))], []
    )
    run(server, lambda kept: kept.names == {"c", "d"})
    assert server.watched_from == ["1", "5", "6"]


def test_an_older_version_never_replaces_a_newer_one() -> None:
    store = Store()
    assert store.put(CONFIG_MAP, config("a", 7, key="new"))
    assert not store.put(CONFIG_MAP, config("a", 6, key="old"))
    assert not store.put(CONFIG_MAP, config("a", 7, key="same"))
    found = store.get(CONFIG_MAP, "fleet", "a")
    assert found is not None
    assert found["data"] == {"key": "new"}


def test_what_was_written_after_a_list_began_outlives_the_end_of_the_list() -> None:
    store = Store()
    store.put(CONFIG_MAP, config("a", 7))
    assert store.prune(CONFIG_MAP, None, frozenset(), "6") == []
    assert store.prune(CONFIG_MAP, "another", frozenset(), "8") == []
    assert store.prune(CONFIG_MAP, "fleet", frozenset(), "8") == [("fleet", "walker")]


def test_the_end_of_an_earlier_object_does_not_drop_its_successor() -> None:
    store = Store()
    store.put(CONFIG_MAP, config("a", 7, "second"))
    assert not store.drop(CONFIG_MAP, "fleet", "a", "first")
    assert store.drop(CONFIG_MAP, "fleet", "a", "second")
    assert len(store) == 0


def test_keys_of_certificates_are_not_kept() -> None:
    store = Store()
    store.put(SECRET, config("walker-robot", 1, **{"tls.key": "c2VjcmV0"}))
    found = store.get(SECRET, "fleet", "walker-robot")
    assert found is not None
    assert "data" not in found
