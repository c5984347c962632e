"""Rules about the pods in the cloud; some hold for a cluster only."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from robot_offload.api.v1alpha1.name_rules import cel_list
from robot_offload.api.v1alpha1.nodes import RESERVED_PREFIX, RESERVED_VARIABLES, Node
from robot_offload.api.v1alpha1.robotoffload import FAST_DDS, RobotOffloadSpec
from robot_offload.api.v1alpha1.rules.findings import repeated
from robot_offload.api.v1alpha1.rules.rule import Rule
from robot_offload.findings import Finding


def _named(node: Node) -> str:
    return f"node {node.name!r}"


RULES: Final[tuple[Rule, ...]] = (
    Rule(
        "spec.cloud.tolerations[]",
        "Contradiction",
        "self.operator != 'Exists' || !has(self.value) || self.value == ''",
        lambda it: it.operator == "Exists" and bool(it.value),
        "operator Exists takes no value; remove it",
        "value",
    ),
    Rule(
        "spec.cloud.tolerations[]",
        "Required",
        "self.operator == 'Exists' || has(self.key)",
        lambda it: it.key is None and it.operator == "Equal",
        "key is missing; give one or write operator: Exists",
        "key",
    ),
    Rule(
        "spec.cloud.tolerations[]",
        "Contradiction",
        "!has(self.tolerationSeconds) || (has(self.effect) && self.effect == 'NoExecute')",
        lambda it: it.toleration_seconds is not None and it.effect != "NoExecute",
        "tolerationSeconds counts for effect NoExecute only; remove it or add that",
        "tolerationSeconds",
    ),
    Rule(
        "spec.nodes[].env[]",
        "ReservedVariable",
        f"!(self.name in {cel_list(RESERVED_VARIABLES)}) && !self.name.startsWith('{RESERVED_PREFIX}')",
        lambda it: it.name in RESERVED_VARIABLES or it.name.startswith(RESERVED_PREFIX),
        "this variable follows from the resource and cannot be set; remove it",
        "name",
        lambda it: it.name,
    ),
    Rule(
        "spec.nodes[].env[]",
        "TwoValues",
        "!has(self.valueFrom) || !has(self.value) || self.value == ''",
        lambda it: it.value_from is not None and bool(it.value),
        "has both value and valueFrom; keep one of the two",
        "value",
        lambda it: it.name,
    ),
    Rule(
        "spec.nodes[].env[].valueFrom",
        "OneSource",
        "has(self.secretKeyRef) != has(self.configMapKeyRef)",
        lambda source: (source.secret_key_ref is None) == (source.config_map_key_ref is None),
        "needs either secretKeyRef or configMapKeyRef, and not both",
    ),
    Rule(
        "spec.nodes[]",
        "TwoImages",
        "!has(self.image) || !has(self.build)",
        lambda node: node.image is not None and node.build is not None,
        "has both image and build; keep one of the two",
        "image",
        _named,
    ),
    Rule(
        "spec.nodes[].build",
        "OneProgram",
        "has(self.executable) != has(self.launch)",
        lambda build: (build.executable is None) == (build.launch is None),
        "needs either executable or launch, and not both",
        "executable",
    ),
    Rule(
        "spec.nodes[].build.git",
        "LocalSource",
        "!self.url.startsWith('file:')",
        lambda git: git.url.startswith("file:"),
        "a cluster builds from a repository on a server, not from files beside the builder; write https:// or ssh://",
        "url",
    ),
    Rule(
        "spec.nodes[].build",
        "NoSecret",
        "has(self.gitSecret) || self.git.url.startsWith('https://') || self.git.url.startsWith('file://')",
        lambda build: build.git.over_ssh and build.git_secret is None,
        "this address is read through ssh, which needs a key: name a Secret of type kubernetes.io/ssh-auth in "
        "gitSecret, or write an address with https://",
        "gitSecret",
    ),
    Rule(
        "spec",
        "NoRegistry",
        "has(self.cloud.registry) || self.nodes.all(n, n.placement == 'Robot' || !has(n.build))",
        lambda spec: bool(spec.built_nodes) and spec.cloud.registry is None,
        "images are built, but it is not said where they are pushed to; add registry under spec.cloud",
        "cloud.registry",
        lambda spec: f"that of {_named(spec.built_nodes[0])}",
    ),
    Rule(
        "spec.nodes[]",
        "NoImage",
        "self.placement == 'Robot' || has(self.image) || has(self.build)",
        lambda node: node.in_cloud and node.image is None and node.build is None,
        "a cluster needs the image of the replica in the cloud; add image or build",
        "image",
        lambda node: f"{_named(node)} has placement {node.placement}",
        alone="warning",
    ),
    Rule(
        "spec.nodes[]",
        "NoProgram",
        "self.placement == 'Robot' || has(self.run)",
        lambda node: node.in_cloud and node.run is None,
        "a cluster must know how to start the replica in the cloud; add run",
        "run",
        lambda node: f"{_named(node)} has placement {node.placement}",
        cluster_only=True,
    ),
    Rule(
        "spec",
        "CloudRmw",
        f"(has(self.cloud.rmw) ? self.cloud.rmw : self.robot.rmw) in {cel_list(FAST_DDS)}",
        lambda spec: spec.cloud_rmw not in FAST_DDS,
        "the cloud's middleware cannot find nodes through discovery servers, as a cluster needs it; write "
        f"rmw: {FAST_DDS[0]} under spec.cloud",
        "cloud.rmw",
        lambda spec: f"it is {spec.cloud_rmw}",
        cluster_only=True,
    ),
)


def pull_secrets_are_unique(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """Kubernetes tells pull secrets apart by name."""
    names = [(f"spec.cloud.imagePullSecrets[{i}].name", it.name) for i, it in enumerate(spec.cloud.image_pull_secrets)]
    yield from repeated(names, "DuplicateSecret", "is listed twice; remove one of the two")


def variables_are_unique(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """No variable is set twice."""
    for i, node in enumerate(spec.nodes):
        names = [(f"spec.nodes[{i}].env[{j}].name", variable.name) for j, variable in enumerate(node.env)]
        yield from repeated(names, "DuplicateVariable", "is set twice; remove one of the two")
