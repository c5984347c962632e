"""Reads what the cluster has of one RobotOffload. Reads only."""

from __future__ import annotations

import asyncio
import hashlib
from collections.abc import Iterable
from dataclasses import dataclass, field

from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.decide.issuer import WRITTEN_BY
from robot_offload.decide.ownership import Key, belongs, key_of
from robot_offload.kube.errors import ForbiddenError, NotFoundError
from robot_offload.kube.kinds import (
    CERTIFICATE,
    CHILD_KINDS,
    CONFIG_MAP,
    DEPLOYMENT,
    NODE,
    POD,
    SECRET,
    SERVICE,
    STATEFUL_SET,
    Kind,
)
from robot_offload.kube.port import KubeApi, Manifest
from robot_offload.objects import labels


@dataclass(slots=True)
class Snapshot:
    """The cluster as far as one RobotOffload is concerned, as it was when it was read.

    Attributes:
        live: objects with the labels of its children, and whoever else bears the name of one.
        nodes: the cluster's nodes, when their addresses matter.
        configs: the ConfigMap entries that its nodes read, by `name/key`; None: it is missing.
    """

    live: dict[Key, Manifest] = field(default_factory=dict)
    nodes: tuple[Manifest, ...] = ()
    configs: dict[str, str | None] = field(default_factory=dict)

    @property
    def config_texts(self) -> dict[str, str]:
        """The entries that exist."""
        return {entry: text for entry, text in self.configs.items() if text is not None}

    @property
    def config_hashes(self) -> dict[str, str]:
        """A short name for the content of each entry; empty: it is missing."""
        return {entry: "" if text is None else _hash(text) for entry, text in self.configs.items()}

    @property
    def versions(self) -> dict[str, str]:
        """Returns the resourceVersions of all live objects by uid."""
        metadata = [child["metadata"] for child in self.live.values()]
        return {found["uid"]: found["resourceVersion"] for found in metadata}

    def ours(self, kind: Kind, name: str, uid: str) -> Manifest | None:
        """Returns a child of the RobotOffload with this uid; None: it is missing or somebody else's."""
        child = self.live.get((kind, name))
        return child if child is not None and belongs(child, uid) else None

    def children(self, uid: str) -> dict[Key, Manifest]:
        """Returns all children of the RobotOffload with this uid."""
        return {key: child for key, child in self.live.items() if belongs(child, uid)}

    def services(self, uid: str) -> list[Manifest]:
        """Returns its Services."""
        return [child for (kind, _), child in self.children(uid).items() if kind == SERVICE]

    def workloads(self, uid: str) -> list[Manifest]:
        """Returns its Deployments and StatefulSets."""
        return [child for (kind, _), child in self.children(uid).items() if kind in (DEPLOYMENT, STATEFUL_SET)]


async def cluster(api: KubeApi, namespace: str, offload: RobotOffload) -> Snapshot:
    """Reads all that the next decisions need of the cluster."""
    lists = [api.list(kind, namespace, _labels(offload)) for kind in CHILD_KINDS]
    children, nodes, configs = await asyncio.gather(
        asyncio.gather(*lists), _nodes(api, offload), _configs(api, namespace, offload)
    )
    seen = Snapshot({key_of(child): child for found in children for child in found}, nodes, configs)
    if _issuer_matters(offload, seen):
        found = await _certificates(api, namespace, offload)
        seen.live.update({key_of(certificate): certificate for certificate in found})
    return seen


async def look_up(api: KubeApi, namespace: str, seen: Snapshot, wanted: Iterable[Key]) -> None:
    """Asks for wanted children that carry no label of ours: somebody else may have their names."""
    missing = [key for key in wanted if key not in seen.live]
    found = await asyncio.gather(*(_get(api, kind, namespace, name) for kind, name in missing))
    seen.live.update({key: manifest for key, manifest in zip(missing, found, strict=True) if manifest is not None})


async def pods(api: KubeApi, namespace: str, offload: RobotOffload) -> tuple[Manifest, ...]:
    """The pods of the children: only worth reading when a workload is not as it should be."""
    return tuple(await api.list(POD, namespace, labels.instance_labels(offload)))


async def build_pods(api: KubeApi, namespace: str, offload: RobotOffload) -> tuple[Manifest, ...]:
    """The pods of build Jobs: only worth reading while a build is not written down yet."""
    return tuple(await api.list(POD, namespace, labels.selector(offload, "build")))


async def secret_types(api: KubeApi, namespace: str, names: Iterable[str]) -> dict[str, str]:
    """Returns the types of those of these Secrets that are there, by name."""
    wanted = sorted(names)
    found = await asyncio.gather(*(api.get(SECRET, namespace, name) for name in wanted))
    return {
        name: str(secret.get("type") or "Opaque")
        for name, secret in zip(wanted, found, strict=True)
        if secret is not None
    }


def config_maps(offload: RobotOffload) -> frozenset[tuple[str, str]]:
    """The entries (name, key) of users' ConfigMaps that the nodes in the cloud read."""
    references = (node.run.parameters_from for node in offload.spec.cloud_nodes if node.run is not None)
    return frozenset(
        (reference.config_map_key_ref.name, reference.config_map_key_ref.key)
        for reference in references
        if reference is not None
    )


def _labels(offload: RobotOffload) -> dict[str, str]:
    return {**labels.instance_labels(offload), labels.MANAGED_BY: labels.MANAGER}


async def _get(api: KubeApi, kind: Kind, namespace: str, name: str) -> Manifest | None:
    return await api.get(kind, namespace, name)


async def _nodes(api: KubeApi, offload: RobotOffload) -> tuple[Manifest, ...]:
    expose = offload.spec.transport.expose
    if expose.type != "NodePort" or expose.host:
        return ()
    try:
        return tuple(await api.list(NODE))
    except ForbiddenError:
        # An operator for one namespace has no rights on nodes; the endpoints stay empty until a host is declared.
        return ()


async def _configs(api: KubeApi, namespace: str, offload: RobotOffload) -> dict[str, str | None]:
    entries = sorted(config_maps(offload))
    found = await asyncio.gather(*(api.get(CONFIG_MAP, namespace, name) for name, _ in entries))
    return {f"{name}/{key}": _entry(manifest, key) for (name, key), manifest in zip(entries, found, strict=True)}


def _entry(config_map: Manifest | None, key: str) -> str | None:
    value = ((config_map or {}).get("data") or {}).get(key)
    return None if value is None else str(value)


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _issuer_matters(offload: RobotOffload, seen: Snapshot) -> bool:
    """Whether objects of cert-manager are, or were, among the children."""
    if offload.spec.transport.certificates.issuer_ref is not None:
        return True
    return any(WRITTEN_BY in (child["metadata"].get("annotations") or {}) for child in seen.live.values())


async def _certificates(api: KubeApi, namespace: str, offload: RobotOffload) -> list[Manifest]:
    try:
        return await api.list(CERTIFICATE, namespace, _labels(offload))
    except (NotFoundError, ForbiddenError):
        return []  # without cert-manager, or without its rights: applying them says so
