"""What was read at the start counts once, for who is there, and only as long as the watch knows no other version."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Sequence
from typing import Any

from robot_offload.controller.preread import Preread
from robot_offload.controller.store import Store
from robot_offload.decide.authorities import SERVES
from robot_offload.kube.kinds import ROBOT_OFFLOAD, SECRET, Kind
from robot_offload.kube.port import Manifest, Selection
from robot_offload.objects.labels import INSTANCE

UID = "0b6c"
HOME = "system"


class Lists:
    """The lists of an API server, one object a page."""

    def __init__(self, *secrets: Manifest) -> None:
        self.secrets = secrets
        self.asked: list[str | None] = []

    async def pages(
        self, kind: Kind, namespace: str | None, selection: Selection
    ) -> AsyncIterator[tuple[Sequence[Manifest], str]]:
        self.asked.append(namespace)
        for one in self.secrets:
            if namespace in (None, one["metadata"]["namespace"]):
                yield [one], "9"


def secret(name: str, namespace: str = "robots", instance: str = "walker", **metadata: Any) -> Manifest:
    return {
        "metadata": {
            "name": name, "namespace": namespace, "uid": f"uid-of-{name}", "resourceVersion": "7",
            "labels": {INSTANCE: instance}, **metadata,
        },
        "data": {"tls.key": "a2V5"},
    }  # fmt: skip


AUTHORITY = secret(f"client-ca-{UID}", HOME, "", annotations={SERVES: "robots/walker"})
OURS = (secret("walker-robot"), AUTHORITY)


def known(*secrets: Manifest) -> Store:
    store = Store()
    store.put(
        ROBOT_OFFLOAD, {"metadata": {"name": "walker", "namespace": "robots", "uid": UID, "resourceVersion": "1"}}
    )
    for one in secrets:
        store.put(SECRET, one)
    return store


def preread(lists: Lists, store: Store, served: tuple[str, ...] = ()) -> Preread:
    found = Preread()
    asyncio.run(found.read(lists, store, served, HOME))  # type: ignore[arg-type]  # only its lists are asked for
    return found


def test_what_was_read_is_given_once_word_for_word() -> None:
    store = known(*OURS)
    found = preread(Lists(*OURS), store)
    assert found.take(store, "robots", "walker-robot") == OURS[0]
    assert found.take(store, "robots", "walker-robot") is None
    assert found.take(store, HOME, f"client-ca-{UID}") == AUTHORITY
    assert len(found) == 0


def test_what_the_watch_knows_in_another_version_or_not_at_all_does_not_count() -> None:
    newer = secret("walker-robot", resourceVersion="8")
    for store in (known(newer), known()):
        assert preread(Lists(*OURS), store).take(store, "robots", "walker-robot") is None


def test_certificates_of_others_are_not_kept() -> None:
    store = known(*OURS)
    assert len(preread(Lists(secret("runner-robot", instance="runner"), *OURS), store)) == 2
    forgotten = preread(Lists(*OURS), store)
    forgotten.forget()
    assert forgotten.take(store, "robots", "walker-robot") is None


def test_only_the_namespaces_that_are_served_are_asked_and_our_own_once() -> None:
    for served, asked in (((), [None]), (("robots",), ["robots", HOME]), (("robots", HOME), ["robots", HOME])):
        lists = Lists(*OURS)
        assert len(preread(lists, known(*OURS), served)) == 2
        assert lists.asked == asked
