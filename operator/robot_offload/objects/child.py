"""What all children have in common: labels, owner, namespace."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from robot_offload.api.v1alpha1 import API_VERSION, KIND, RobotOffload
from robot_offload.objects.facts import Facts, Manifest
from robot_offload.objects.labels import Component, labels


def child(
    offload: RobotOffload,
    facts: Facts,
    api_version: str,
    kind: str,
    name: str,
    component: Component,
    body: Mapping[str, Any],
    annotations: Mapping[str, str] | None = None,
) -> Manifest:
    """An object that belongs to the RobotOffload and goes away with it."""
    metadata: Manifest = {
        "name": name,
        "namespace": facts.namespace,
        "labels": labels(offload, component),
        "ownerReferences": [owner(offload, facts)],
    }
    if annotations:
        metadata["annotations"] = dict(annotations)
    return {"apiVersion": api_version, "kind": kind, "metadata": metadata, **body}


def owner(offload: RobotOffload, facts: Facts) -> Manifest:
    """The owner reference of a child; the cluster's own garbage collector needs nothing else."""
    return {
        "apiVersion": API_VERSION,
        "kind": KIND,
        "name": offload.metadata.name,
        "uid": facts.uid,
        "controller": True,
        "blockOwnerDeletion": True,
    }


def config_map(
    offload: RobotOffload, facts: Facts, name: str, component: Component, data: Mapping[str, str]
) -> Manifest:
    """A ConfigMap of texts."""
    return child(offload, facts, "v1", "ConfigMap", name, component, {"data": dict(data)})
