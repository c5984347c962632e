"""The children of all RobotOffloads from the watches, so that a pass over unchanged ones makes no request.

Objects are kept packed: a parsed Deployment takes some 30 KiB, a packed one less than one. Secrets are kept without
their content. The store may lag by the delivery time of an event. What a pass would write, and what is in its way, is
therefore first read again from the API server.

The answer to a write may arrive after the object's deletion. The uids of deleted objects are kept for a while, so that
such an answer does not bring them back.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Final

from robot_offload.decide import authors
from robot_offload.decide.ownership import Key
from robot_offload.kube.kinds import CHILD_KINDS, POD, ROBOT_OFFLOAD, SECRET, Kind
from robot_offload.kube.port import Manifest
from robot_offload.objects import labels

_KEPT_OF_PODS: Final = ("phase", "conditions", "initContainerStatuses", "containerStatuses")
_LEVEL: Final = 1
_REMEMBERED: Final = 10_000
"""Uids of deleted objects: far more than there are writes in flight."""


@dataclass(frozen=True, slots=True)
class Entry:
    """An object in the store.

    Attributes:
        uid: its identity.
        version: its resourceVersion.
        generation: of its specification; 0: its kind has none.
        instance: the RobotOffload in its label; empty: none.
        packed: its content.
    """

    uid: str
    version: str
    generation: int
    instance: str
    packed: bytes

    def manifest(self) -> Manifest:
        """Return the object; the caller may keep and change it."""
        manifest: Manifest = json.loads(zlib.decompress(self.packed))
        return manifest


class Store:
    """All objects of the kinds read by a pass, by kind, namespace and name."""

    def __init__(self) -> None:
        self.fed = False
        """Whether watches keep the store current; until then everything is read from the API server."""
        self.config_versions: dict[tuple[str, str], str] = {}
        """ConfigMaps that are not ours: their resourceVersions by namespace and name."""
        self._entries: dict[tuple[Kind, str, str], Entry] = {}
        self._instances: dict[tuple[str, str], set[Key]] = {}
        self._gone: dict[str, None] = {}

    def __len__(self) -> int:
        """Return the number of objects."""
        return len(self._entries)

    def put(self, kind: Kind, manifest: Manifest) -> bool:
        """Store an object; return whether it is new: not known in this version or a newer one, and not deleted."""
        metadata = manifest["metadata"]
        if str(metadata["uid"]) in self._gone:
            return False
        place = (kind, str(metadata.get("namespace") or ""), str(metadata["name"]))
        before = self._entries.get(place)
        if before is not None and not older(before.version, str(metadata["resourceVersion"])):
            return False
        self._forget(place)
        instance = str((metadata.get("labels") or {}).get(labels.INSTANCE) or "")
        generation = int(metadata.get("generation") or 0)
        entry = Entry(
            str(metadata["uid"]), str(metadata["resourceVersion"]), generation, instance, _pack(kind, manifest)
        )
        self._entries[place] = entry
        if instance and kind != ROBOT_OFFLOAD:
            self._instances.setdefault((place[1], instance), set()).add((kind, place[2]))
        return True

    def drop(self, kind: Kind, namespace: str, name: str, uid: str = "") -> bool:
        """Drop an object, if it has this uid (empty: any); return whether it was there."""
        if uid:
            self._bury(uid)
        place = (kind, namespace, name)
        before = self._entries.get(place)
        if before is None or (uid and before.uid != uid):
            return False
        self._bury(before.uid)
        self._forget(place)
        return True

    def prune(
        self, kind: Kind, namespace: str | None, there: frozenset[tuple[str, str]], version: str
    ) -> list[tuple[str, str]]:
        """Drop the objects of a kind that a list of this version lacks; return namespace and instance of each."""
        gone = [
            (place, entry)
            for place, entry in self._entries.items()
            if place[0] == kind
            and namespace in (None, place[1])
            and place[1:] not in there
            and older(entry.version, version)
        ]
        for place, entry in gone:
            self._bury(entry.uid)
            self._forget(place)
        return [(place[1], place[2] if kind == ROBOT_OFFLOAD else entry.instance) for place, entry in gone]

    def entry(self, kind: Kind, namespace: str, name: str) -> Entry | None:
        """Return an object as it is kept."""
        return self._entries.get((kind, namespace, name))

    def get(self, kind: Kind, namespace: str, name: str) -> Manifest | None:
        """Return an object."""
        entry = self.entry(kind, namespace, name)
        return None if entry is None else entry.manifest()

    def entries(self, kind: Kind, namespace: str) -> list[tuple[str, Entry]]:
        """Return the names of all objects of a kind in a namespace, with the objects."""
        return [(place[2], entry) for place, entry in self._entries.items() if place[:2] == (kind, namespace)]

    def uids(self, kind: Kind) -> frozenset[str]:
        """Return the uids of all objects of a kind."""
        return frozenset(entry.uid for place, entry in self._entries.items() if place[0] == kind)

    def children(self, namespace: str, instance: str, kinds: Iterable[Kind] = CHILD_KINDS) -> dict[Key, Manifest]:
        """Return the objects that carry the label of a RobotOffload."""
        wanted = frozenset(kinds)
        keys = sorted(self._instances.get((namespace, instance), ()), key=lambda key: (key[0].kind, key[1]))
        return {key: self._entries[key[0], namespace, key[1]].manifest() for key in keys if key[0] in wanted}

    def owners(self, kinds: Iterable[Kind], suits: Callable[[Manifest], bool]) -> frozenset[tuple[str, str]]:
        """Return namespace and name of the RobotOffloads with a child of these kinds for which `suits` is true."""
        wanted = frozenset(kinds)
        found: set[tuple[str, str]] = set()
        for owner, keys in self._instances.items():
            entries = (self._entries[kind, owner[0], name] for kind, name in keys if kind in wanted)
            if any(suits(entry.manifest()) for entry in entries):
                found.add(owner)
        return frozenset(found)

    def named(self, kind: Kind, suits: Callable[[Manifest], bool]) -> frozenset[tuple[str, str]]:
        """Return namespace and name of the objects of a kind for which `suits` is true."""
        entries = ((place, entry) for place, entry in self._entries.items() if place[0] == kind)
        return frozenset(place[1:] for place, entry in entries if suits(entry.manifest()))

    def versions(self, namespace: str, instance: str, without: Iterable[Kind] = ()) -> frozenset[tuple[Key, str, str]]:
        """Return key, uid and version of these objects, except of some kinds; an equal set means no change."""
        left_out = frozenset(without)
        keys = self._instances.get((namespace, instance), ())
        entries = ((key, self._entries[key[0], namespace, key[1]]) for key in keys if key[0] not in left_out)
        return frozenset((key, entry.uid, entry.version) for key, entry in entries)

    def buried(self, uid: str) -> bool:
        """Return whether an object is known to be deleted."""
        return uid in self._gone

    def _bury(self, uid: str) -> None:
        """Record that an object was deleted: its uid never comes back."""
        self._gone[uid] = None
        if len(self._gone) > _REMEMBERED:
            del self._gone[next(iter(self._gone))]

    def _forget(self, place: tuple[Kind, str, str]) -> None:
        entry = self._entries.pop(place, None)
        if entry is None or not entry.instance:
            return
        owner = (place[1], entry.instance)
        keys = self._instances.get(owner)
        if keys is not None:
            keys.discard((place[0], place[2]))
            if not keys:
                del self._instances[owner]


def older(seen: str, version: str) -> bool:
    """Return whether the seen version is older than `version`. Versions are numbers wherever Kubernetes runs."""
    try:
        return int(seen) < int(version)
    except ValueError:
        return seen != version


def _pack(kind: Kind, manifest: Manifest) -> bytes:
    metadata = {name: value for name, value in manifest["metadata"].items() if name != "managedFields"}
    if kind == ROBOT_OFFLOAD:
        metadata["managedFields"] = authors.kept(manifest["metadata"])
    content: dict[str, Any] = {**manifest, "apiVersion": kind.api_version, "kind": kind.kind, "metadata": metadata}
    if kind == POD:
        status = manifest.get("status") or {}
        content = {
            **{name: content[name] for name in ("apiVersion", "kind", "metadata")},
            "status": {name: status[name] for name in _KEPT_OF_PODS if name in status},
        }
    if kind == SECRET:
        content.pop("data", None)
    return zlib.compress(json.dumps(content, separators=(",", ":")).encode(), _LEVEL)
