"""What has gone stays gone, whatever arrives late."""

from __future__ import annotations

from robot_offload.controller.store import Store
from robot_offload.kube.kinds import SERVICE
from robot_offload.kube.port import Manifest
from robot_offload.objects.labels import INSTANCE


def service(uid: str, version: str) -> Manifest:
    labels = {INSTANCE: "walker"}
    metadata = {"name": "walker-udp", "namespace": "robots", "uid": uid, "resourceVersion": version, "labels": labels}
    return {"apiVersion": "v1", "kind": "Service", "metadata": metadata}


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
