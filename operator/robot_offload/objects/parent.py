"""A RobotOffload as the parent of its objects in the cluster: what all children share.

Builders take a `Parent` (the declaration, and the known state of the cluster) and give each child its kind, its part
and its body; name, namespace, labels and owner come from here.
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
"""Characters, from X.520."""


@dataclass(frozen=True, slots=True)
class Part:
    """One part of a RobotOffload: the name of its objects, and the labels for finding its pods.

    Attributes:
        name: of the objects.
        component: for their labels.
        own: labels that distinguish the pods of this part from others of the same component.
    """

    name: str
    component: Component
    own: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Parent:
    """A RobotOffload and the known state of the cluster: all that builders of its children read.

    Attributes:
        offload: the declaration, as accepted.
        facts: the part of the cluster's state on which the children depend.
    """

    offload: RobotOffload
    facts: Facts

    @property
    def name(self) -> str:
        """Return the name of the RobotOffload."""
        return self.offload.metadata.name

    @property
    def spec(self) -> RobotOffloadSpec:
        """Return the declaration."""
        return self.offload.spec

    @property
    def namespace(self) -> str:
        """Return the Kubernetes namespace of the RobotOffload and of all its children."""
        return self.facts.namespace

    @property
    def uid(self) -> str:
        """Return the uid of the RobotOffload, which identifies its children."""
        return self.facts.uid

    @property
    def identity(self) -> str:
        """Return the uid by which robot and cloud know each other; it may be an earlier RobotOffload's of this name."""
        return self.facts.identity or self.facts.uid

    @property
    def agent_image(self) -> str:
        """Return the image of the agent: the declared one, or else the operator's default."""
        return self.spec.cloud.agent.image or self.facts.images.agent

    def certificate_name(self, side: Side) -> str:
        """Return the common name in the certificate of a side, which the other side requires.

        An issuer may sign for many RobotOffloads, of several namespaces, so the name identifies the RobotOffload. With
        its underscore it is not a host name, so no public authority certifies it.
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
        """Return an object that belongs to the RobotOffload and is deleted with it."""
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
        """Return the labels with which the pods of a part are selected; they never change."""
        return {**labels.selector(self.offload, part.component), **part.own}

    def _owner(self) -> Manifest:
        """Return the owner reference, which is all that the cluster's garbage collector needs."""
        return {
            "apiVersion": API_VERSION,
            "kind": KIND,
            "name": self.name,
            "uid": self.uid,
            "controller": True,
            "blockOwnerDeletion": True,
        }
