"""The store keeps the newest version of what is there, and what has gone stays gone, whatever arrives late."""

from __future__ import annotations

from robot_offload.controller.store import Store
from robot_offload.kube.kinds import CONFIG_MAP, SECRET, SERVICE
from robot_offload.kube.port import Manifest
from robot_offload.objects.labels import INSTANCE


def service(uid: str, version: str) -> Manifest:
    labels = {INSTANCE: "walker"}
    metadata = {"name": "walker-udp", "namespace": "robots", "uid": uid, "resourceVersion": version, "labels": labels}
    return {"apiVersion": "v1", "kind": "Service", "metadata": metadata}


def config(name: str, version: int, uid: str = "", **data: str) -> Manifest:
    labels = {INSTANCE: "walker"}
    metadata = {"namespace": "fleet", "name": name, "uid": uid or f"u-{name}", "labels": labels}
    return {"metadata": {**metadata, "resourceVersion": str(version)}, "data": data}


def test_the_late_answer_of_a_write_brings_no_deleted_object_back() -> None:
    store = Store()
    assert store.put(SERVICE, service("first", "7"))
    assert store.drop(SERVICE, "robots", "walker-udp", "first")
    assert not store.put(SERVICE, service("first", "7"))
    assert store.children("robots", "walker") == {}


def test_the_late_answer_of_a_write_counts_for_nothing_also_when_the_store_did_not_know_the_object() -> None:
    store = Store()
    assert not store.drop(SERVICE, "robots", "walker-udp", "first")
    assert not store.put(SERVICE, service("first", "7"))


def test_a_deleted_object_does_not_keep_its_successor_out() -> None:
    store = Store()
    store.put(SERVICE, service("first", "7"))
    store.drop(SERVICE, "robots", "walker-udp", "first")
    assert store.put(SERVICE, service("second", "9"))
    assert not store.put(SERVICE, service("first", "8"))
    entry = store.entry(SERVICE, "robots", "walker-udp")
    assert entry is not None
    assert entry.uid == "second"


def test_what_a_list_does_not_have_is_gone_for_good() -> None:
    store = Store()
    store.put(SERVICE, service("first", "7"))
    assert store.prune(SERVICE, None, frozenset(), "9") == [("robots", "walker")]
    assert not store.put(SERVICE, service("first", "7"))


def test_what_was_written_after_a_list_is_not_missed_by_it() -> None:
    store = Store()
    store.put(SERVICE, service("first", "10"))
    assert store.prune(SERVICE, None, frozenset(), "9") == []
    assert store.entry(SERVICE, "robots", "walker-udp") is not None


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
