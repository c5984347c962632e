"""Rules about the pods in the cloud; some hold for a cluster only."""

from __future__ import annotations

from collections.abc import Iterator

from robot_offload.api.v1alpha1.checks.findings import Check, repeated
from robot_offload.api.v1alpha1.nodes import RESERVED_VARIABLES
from robot_offload.api.v1alpha1.robotoffload import FAST_DDS, RobotOffloadSpec
from robot_offload.findings import Finding, Severity


def pull_secrets_are_unique(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """Kubernetes tells pull secrets apart by name."""
    names = [(f"spec.cloud.imagePullSecrets[{i}].name", it.name) for i, it in enumerate(spec.cloud.image_pull_secrets)]
    yield from repeated(names, "DuplicateSecret", "is listed twice; remove one of the two")


def tolerations_are_complete(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """The rules that Kubernetes has for tolerations, told before a pod is refused."""
    for i, toleration in enumerate(spec.cloud.tolerations):
        path = f"spec.cloud.tolerations[{i}]"
        if toleration.operator == "Exists" and toleration.value:
            yield Finding(f"{path}.value", "Contradiction", "operator Exists takes no value; remove it")
        if toleration.key is None and toleration.operator == "Equal":
            yield Finding(f"{path}.key", "Required", "is missing; give a key or write operator: Exists")
        if toleration.toleration_seconds is not None and toleration.effect != "NoExecute":
            yield Finding(
                f"{path}.tolerationSeconds", "Contradiction", "counts for effect NoExecute only; remove it or add that"
            )


def environment_is_free(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """No variable is set twice, and none of those by which nodes find each other."""
    for i, node in enumerate(spec.nodes):
        names = [(f"spec.nodes[{i}].env[{j}].name", variable.name) for j, variable in enumerate(node.env)]
        yield from repeated(names, "DuplicateVariable", "is set twice; remove one of the two")
        for path, name in names:
            if name in RESERVED_VARIABLES:
                yield Finding(
                    path, "ReservedVariable", f"{name!r} follows from the resource and cannot be set; remove it"
                )


def cloud_nodes_have_images(severity: Severity) -> Check:
    """A cluster starts containers; one machine starts processes, so there it is only a warning."""

    def check_images(spec: RobotOffloadSpec) -> Iterator[Finding]:
        for i, node in enumerate(spec.nodes):
            if node.in_cloud and node.image is None and node.build is None:
                yield Finding(
                    f"spec.nodes[{i}].image",
                    "NoImage",
                    f"node {node.name!r} has placement {node.placement}, so a cluster needs the image of its replica "
                    "in the cloud; add image or build",
                    severity,
                )

    return check_images


def images_come_from_one_place(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """An image is named or built, and what is built has a program and a place to go to."""
    for i, node in enumerate(spec.nodes):
        if node.build is None:
            continue
        path = f"spec.nodes[{i}]"
        if node.image is not None:
            yield Finding(
                f"{path}.image", "TwoImages", f"node {node.name!r} has both image and build; keep one of both"
            )
        if (node.build.executable is None) == (node.build.launch is None):
            found = "both" if node.build.launch else "none"
            yield Finding(f"{path}.build.executable", "OneProgram", f"needs either executable or launch, found {found}")
    if spec.built_nodes and spec.cloud.registry is None:
        yield Finding(
            "spec.cloud.registry",
            "NoRegistry",
            f"the image of node {spec.built_nodes[0].name!r} is built, but it is not said where it is pushed to; add "
            "registry with repository",
        )


def git_secrets_fit(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """An address that is read through ssh cannot be read by nobody."""
    for i, node in enumerate(spec.nodes):
        if node.build is not None and node.build.git.over_ssh and node.build.git_secret is None:
            yield Finding(
                f"spec.nodes[{i}].build.gitSecret",
                "NoSecret",
                "this address is read through ssh, which needs a key; name a Secret of type kubernetes.io/ssh-auth, or "
                "write an address with https://",
            )


def cloud_nodes_say_how_they_start(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """Without a command line nobody could give the replica its name, its parameters and its private topics."""
    for i, node in enumerate(spec.nodes):
        if node.in_cloud and node.run is None:
            yield Finding(
                f"spec.nodes[{i}].run",
                "NoProgram",
                f"node {node.name!r} has placement {node.placement}, so a cluster must know how to start it; add run",
            )


def cloud_rmw_knows_discovery_servers(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """Clusters carry no multicast, so nodes find each other through discovery servers."""
    if spec.cloud_rmw not in FAST_DDS:
        yield Finding(
            "spec.cloud.rmw",
            "CloudRmw",
            f"{spec.cloud_rmw} cannot find nodes through discovery servers, as a cluster needs it; write "
            f"rmw: {FAST_DDS[0]} under spec.cloud",
        )
