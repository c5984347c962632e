"""A RobotOffload as the parent of its objects in the cluster: what all children have in common.

Builders take a `Parent` (what is declared, and what is known of the cluster) and say for each child its kind, the part
that the child belongs to and its body; name, namespace, labels and owner come from here.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from robot_offload.api.v1alpha1 import API_VERSION, KIND, RobotOffload, RobotOffloadSpec
from robot_offload.api.v1alpha1.names import Side
from robot_offload.kube.kinds import CONFIG_MAP, Kind
from robot_offload.kube.port import Manifest
from robot_offload.objects import labels
from robot_offload.objects.facts import Facts
from robot_offload.objects.labels import Component

MAX_COMMON_NAME: Final = 64
"""Characters, by X.520."""


@dataclass(frozen=True, slots=True)
class Part:
    """What the objects of one part of a RobotOffload are called, and by which labels its pods are found.

    Attributes:
        name: of the objects.
        component: which labels they carry.
        own: labels that tell the pods of this part from others of the same component.
    """

    name: str
    component: Component
    own: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Parent:
    """A RobotOffload and what is known of the cluster: all that builders of its children read.

    Attributes:
        offload: what is declared, as it was accepted.
        facts: the state of the cluster as far as the children depend on it.
    """

    offload: RobotOffload
    facts: Facts

    @property
    def name(self) -> str:
        """Return the name of the RobotOffload."""
        return self.offload.metadata.name

    @property
    def spec(self) -> RobotOffloadSpec:
        """Return what is declared."""
        return self.offload.spec

    @property
    def namespace(self) -> str:
        """Return the Kubernetes namespace of the RobotOffload and of all its children."""
        return self.facts.namespace

    @property
    def uid(self) -> str:
        """Return the uid of the RobotOffload, by which children are known as its own."""
        return self.facts.uid

    @property
    def identity(self) -> str:
        """Return the uid by which robot and cloud know each other; it may be an earlier RobotOffload's of this name."""
        return self.facts.identity or self.facts.uid

    @property
    def agent_image(self) -> str:
        """Return the image of the agent: the declared one, or else the one that the operator was given."""
        return self.spec.cloud.agent.image or self.facts.images.agent

    def certificate_name(self, side: Side) -> str:
        """Return the common name in the certificate of a side: what its other side insists on.

        An issuer may sign for many RobotOffloads, of several namespaces, so the names say which one. With an underscore
        they are names of no host, and no public authority certifies them.
        """
        if self.spec.transport.certificates.issuer_ref is None:
            return self.name if side == "robot" else "cloud"
        whose = f"{self.name}_{self.namespace}"
        text = whose if side == "robot" else f"cloud_{whose}"
        if len(text) <= MAX_COMMON_NAME:
            return text
        digest = hashlib.sha256(text.encode()).hexdigest()[:16]
        return f"{text[: MAX_COMMON_NAME - 17]}_{digest}"

    def child(
        self, kind: Kind, part: Part, body: Mapping[str, object], annotations: Mapping[str, str] | None = None
    ) -> Manifest:
        """Return an object that belongs to the RobotOffload and goes away with it."""
        metadata: Manifest = {
            "name": part.name,
            "namespace": self.namespace,
            "labels": labels.labels(self.offload, part.component),
            "ownerReferences": [self._owner()],
        }
        if annotations:
            metadata["annotations"] = dict(annotations)
        return {"apiVersion": kind.api_version, "kind": kind.kind, "metadata": metadata, **body}

    def config_map(self, part: Part, data: Mapping[str, str]) -> Manifest:
        """Return a ConfigMap of texts."""
        return self.child(CONFIG_MAP, part, {"data": dict(data)})

    def selector(self, part: Part) -> dict[str, str]:
        """Return the labels by which the pods of a part are found; they never change."""
        return {**labels.selector(self.offload, part.component), **part.own}

    def _owner(self) -> Manifest:
        """Return the owner reference; the cluster's own garbage collector needs nothing else."""
        return {
            "apiVersion": API_VERSION,
            "kind": KIND,
            "name": self.name,
            "uid": self.uid,
            "controller": True,
            "blockOwnerDeletion": True,
        }
