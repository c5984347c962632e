"""Reads the cluster's objects of one RobotOffload. Reads only."""

from __future__ import annotations

import asyncio
import hashlib
import json
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Final

from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.controller.store import Store
from robot_offload.decide.issuer import WRITTEN_BY
from robot_offload.decide.ownership import Key, belongs, key_of
from robot_offload.kube.errors import ForbiddenError, NotFoundError
from robot_offload.kube.kinds import (
    CERTIFICATE,
    CHILD_KINDS,
    CONFIG_MAP,
    DEPLOYMENT,
    EVENT,
    NODE,
    POD,
    SECRET,
    SERVICE,
    STATEFUL_SET,
    Kind,
)
from robot_offload.kube.port import KubeApi, Manifest, Selection
from robot_offload.objects import labels

_NO_POD: Final = "FailedCreate"
"""The reason of events by which Kubernetes' controllers report that the API server refused a pod."""


@dataclass(slots=True)
class Snapshot:
    """The cluster as far as one RobotOffload is concerned, as it was when it was read.

    Attributes:
        live: objects with the labels of its children, and foreign objects that have the name of one.
        nodes: the cluster's nodes, if their addresses matter.
        configs: the ConfigMap entries that its nodes read, by `name/key`; None: missing.
        fresh: objects that this pass read from the API server itself.
    """

    live: dict[Key, Manifest] = field(default_factory=dict)
    nodes: tuple[Manifest, ...] = ()
    configs: dict[str, str | None] = field(default_factory=dict)
    fresh: set[Key] = field(default_factory=set)

    @property
    def config_texts(self) -> dict[str, str]:
        """The entries that exist."""
        return {entry: text for entry, text in self.configs.items() if text is not None}

    @property
    def config_hashes(self) -> dict[str, str]:
        """A short name for the content of each entry; empty: it is missing."""
        return {entry: "" if text is None else _hash(text) for entry, text in self.configs.items()}

    def ours(self, kind: Kind, name: str, uid: str) -> Manifest | None:
        """Return a child of the RobotOffload with this uid; None: it is missing or has another owner."""
        child = self.live.get((kind, name))
        return child if child is not None and belongs(child, uid) else None

    def children(self, uid: str) -> dict[Key, Manifest]:
        """Return all children of the RobotOffload with this uid."""
        return {key: child for key, child in self.live.items() if belongs(child, uid)}

    def services(self, uid: str) -> list[Manifest]:
        """Return its Services."""
        return [child for (kind, _), child in self.children(uid).items() if kind == SERVICE]

    def workloads(self, uid: str) -> list[Manifest]:
        """Return its Deployments and StatefulSets."""
        return [child for (kind, _), child in self.children(uid).items() if kind in (DEPLOYMENT, STATEFUL_SET)]


class Observer:
    """Reads for one pass: watched kinds from the store, the others from the API server."""

    def __init__(self, api: KubeApi, store: Store, namespace: str, offload: RobotOffload) -> None:
        self._api = api
        self._store = store
        self._namespace = namespace
        self._offload = offload

    async def cluster(self, cached: dict[str, CachedConfig]) -> Snapshot:
        """Read all that the next decisions need of the cluster.

        Args:
            cached: users' ConfigMaps as last read, by name; updated.
        """
        children, nodes, configs = await asyncio.gather(
            self._children(), _nodes(self._api, self._offload), self._configs(cached)
        )
        seen = Snapshot(children, nodes, configs)
        seen.fresh |= set() if self._store.fed else set(children)
        if _issuer_matters(self._offload, seen):
            found = await _certificates(self._api, self._namespace, self._offload)
            seen.live.update({key_of(certificate): certificate for certificate in found})
        return seen

    async def confirm(self, seen: Snapshot, keys: Iterable[Key]) -> None:
        """Read the objects that a write would touch from the API server, once a pass: the store may be old.

        Also finds foreign objects with the name of a missing child.
        """
        asked = [key for key in keys if key not in seen.fresh]
        found = await asyncio.gather(*map(self._confirmed, asked))
        for key, manifest in zip(asked, found, strict=True):
            seen.fresh.add(key)
            if manifest is None:
                seen.live.pop(key, None)
                self._store.drop(key[0], self._namespace, key[1])
            else:
                seen.live[key] = manifest

    async def _confirmed(self, key: Key) -> Manifest | None:
        """Return an object; None: it is missing, or is cert-manager's and unreadable: applying it then reports that."""
        kind, name = key
        try:
            return await self._api.get(kind, self._namespace, name)
        except ForbiddenError:
            if kind == CERTIFICATE:
                return None
            raise

    async def pods(self) -> tuple[Manifest, ...]:
        """Return the pods of the children: only worth reading when a workload is not as it should be."""
        return tuple(await self._pods(labels.instance_labels(self._offload)))

    async def refusals(self, workloads: Iterable[Manifest]) -> dict[Key, str]:
        """Return why the API server refuses the pods of these workloads, in its words; only events contain that."""
        asked = list(workloads)
        found = await asyncio.gather(*(self._refusal(one["metadata"]["uid"]) for one in asked))
        return {key_of(one): words for one, words in zip(asked, found, strict=True) if words}

    async def _refusal(self, uid: str) -> str:
        events: list[Manifest] = []
        selection = Selection(fields=f"involvedObject.uid={uid},reason={_NO_POD}")
        async for page, _ in self._api.pages(EVENT, self._namespace, selection):
            events += page
        newest = max(events, key=lambda event: str(event.get("lastTimestamp") or event.get("eventTime")), default={})
        return str(newest.get("message") or "")

    async def build_pods(self) -> tuple[Manifest, ...]:
        """Return the pods of build Jobs: only worth reading while the result of a build is not recorded."""
        return tuple(await self._pods(labels.selector(self._offload, "build")))

    async def secret_types(self, names: Iterable[str]) -> dict[str, str]:
        """Return the types of the Secrets among these that exist, by name. Users' own Secrets are not watched."""
        wanted = sorted(names)
        found = await asyncio.gather(*(self._api.get(SECRET, self._namespace, name) for name in wanted))
        there = {name: secret for name, secret in zip(wanted, found, strict=True) if secret is not None}
        return {name: str(secret.get("type") or "Opaque") for name, secret in there.items()}

    async def _children(self) -> dict[Key, Manifest]:
        if self._store.fed:
            return self._store.children(self._namespace, self._offload.metadata.name)
        wanted = _labels(self._offload)
        lists = await asyncio.gather(*(self._api.list(kind, self._namespace, wanted) for kind in CHILD_KINDS))
        return {key_of(child): child for found in lists for child in found}

    async def _pods(self, wanted: Mapping[str, str]) -> Iterable[Manifest]:
        if not self._store.fed:
            return await self._api.list(POD, self._namespace, wanted)
        found = self._store.children(self._namespace, self._offload.metadata.name, (POD,)).values()
        return [pod for pod in found if wanted.items() <= (pod["metadata"].get("labels") or {}).items()]

    async def _configs(self, cached: dict[str, CachedConfig]) -> dict[str, str | None]:
        entries = sorted(config_maps(self._offload))
        names = sorted({name for name, _ in entries})
        for gone in set(cached) - set(names):
            del cached[gone]
        await asyncio.gather(*(self._config(name, cached) for name in names))
        return {f"{name}/{key}": _entry(cached[name].manifest(), key) for name, key in entries}

    async def _config(self, name: str, cached: dict[str, CachedConfig]) -> None:
        version = self._store.config_versions.get((self._namespace, name)) if self._store.fed else None
        if version is None or name not in cached or cached[name].version != version:
            found = await self._api.get(CONFIG_MAP, self._namespace, name)
            cached[name] = CachedConfig.of(found)


@dataclass(frozen=True, slots=True)
class CachedConfig:
    """A user's ConfigMap as last read.

    Attributes:
        version: its resourceVersion; empty: it did not exist.
        packed: its entries.
    """

    version: str
    packed: bytes

    @classmethod
    def of(cls, config_map: Manifest | None) -> CachedConfig:
        """Pack a ConfigMap as read."""
        found = config_map or {"metadata": {"resourceVersion": ""}}
        text = json.dumps({"data": found.get("data") or {}})
        return cls(str(found["metadata"]["resourceVersion"]), zlib.compress(text.encode(), 1))

    def manifest(self) -> Manifest:
        """Return the entries as a manifest has them."""
        manifest: Manifest = json.loads(zlib.decompress(self.packed))
        return manifest


def config_maps(offload: RobotOffload) -> frozenset[tuple[str, str]]:
    """Return the entries (name, key) of users' ConfigMaps that the nodes in the cloud read."""
    references = (node.run.parameters_from for node in offload.spec.cloud_nodes if node.run is not None)
    return frozenset(
        (reference.config_map_key_ref.name, reference.config_map_key_ref.key)
        for reference in references
        if reference is not None
    )


def _labels(offload: RobotOffload) -> dict[str, str]:
    return {**labels.instance_labels(offload), labels.MANAGED_BY: labels.MANAGER}


async def _nodes(api: KubeApi, offload: RobotOffload) -> tuple[Manifest, ...]:
    expose = offload.spec.transport.expose
    if expose.type != "NodePort" or expose.host:
        return ()
    try:
        return tuple(await api.list(NODE))
    except ForbiddenError:
        # An operator for one namespace has no rights on nodes; the endpoints stay empty until a host is declared.
        return ()


def _entry(config_map: Manifest | None, key: str) -> str | None:
    value = ((config_map or {}).get("data") or {}).get(key)
    return None if value is None else str(value)


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _issuer_matters(offload: RobotOffload, seen: Snapshot) -> bool:
    """Return whether objects of cert-manager are, or were, among the children."""
    if offload.spec.transport.certificates.issuer_ref is not None:
        return True
    return any(WRITTEN_BY in (child["metadata"].get("annotations") or {}) for child in seen.live.values())


async def _certificates(api: KubeApi, namespace: str, offload: RobotOffload) -> list[Manifest]:
    try:
        return await api.list(CERTIFICATE, namespace, _labels(offload))
    except (NotFoundError, ForbiddenError):
        return []  # without cert-manager, or without rights on it: applying them reports that
