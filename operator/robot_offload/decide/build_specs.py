"""Turns a node's `build` block into a build: one description for the cluster and the command line."""

from __future__ import annotations

from typing import Final, Literal

from robot_offload.api.v1alpha1 import BuildFields, Node, NodeBuild, RobotOffload, RobotOffloadSpec
from robot_offload.images.dockerfiles import dockerfile
from robot_offload.images.spec import BuildSpec, GitSource, WorkspaceSource
from robot_offload.objects.hashes import config_hash
from robot_offload.objects.names import BUILD, child_name
from robot_offload.render.build_job import BuildPlan

SOURCE_DIR: Final = "src"
"""Where a build Job puts the source, in the build's folder."""
_HIGHEST_USER: Final = 65534
_ARCHITECTURE: Final = "kubernetes.io/arch"


def from_git(spec: RobotOffloadSpec, node: Node, build: NodeBuild) -> BuildSpec:
    """Return the specification for a builder outside the cluster, which fetches the source itself."""
    credentials: Literal["None", "SSH", "Token"] = (
        "None" if build.git_secret is None else "SSH" if build.git.over_ssh else "Token"
    )
    source = GitSource(url=build.git.url, ref=build.git.ref, paths=build.git.paths, credentials=credentials)
    return _spec(spec, node, build).model_copy(update={"git": source})


def in_cluster(spec: RobotOffloadSpec, node: Node, build: NodeBuild) -> BuildSpec:
    """Return what a build Job uses: the source is already in a folder, so no layer of a moved branch can be old."""
    return _spec(spec, node, build).model_copy(update={"workspace": WorkspaceSource(paths=(SOURCE_DIR,))})


def build_plans(offload: RobotOffload, rebuild: str) -> tuple[BuildPlan, ...]:
    """Return every image that the resource asks to build; nodes with equal builds share one.

    Args:
        offload: as accepted.
        rebuild: any text; a changed one requests another build of the same specification.
    """
    spec, registry = offload.spec, offload.spec.cloud.registry
    plans: dict[str, BuildPlan] = {}
    for node in spec.built_nodes:
        if node.build is None or registry is None:
            continue
        told = in_cluster(spec, node, node.build)
        placed = {label: value for label, value in node.node_selector.items() if label == _ARCHITECTURE}
        # Not the Dockerfile and no defaults: a newer operator that words it differently, or knows further fields, must
        # not build everything anew.
        key = config_hash(
            told.model_dump(mode="json", exclude_defaults=True),
            node.build.git.model_dump(mode="json", exclude_defaults=True),
            registry.repository,
            placed,
            rebuild,
        )
        nodes = (*plans[key].nodes, node.name) if key in plans else (node.name,)
        name = child_name(offload.metadata.name, BUILD, told.package.replace("_", "-"), key)
        plans[key] = BuildPlan(nodes, node.build, registry, key, name, dockerfile(told), placed)
    return tuple(plans.values())


def _spec(spec: RobotOffloadSpec, node: Node, build: NodeBuild) -> BuildSpec:
    user = spec.cloud.run_as_user
    shared = {field: getattr(build, field) for field in BuildFields.model_fields}
    return BuildSpec(
        **shared,
        distro=build.distro or spec.robot.ros_distro,
        rmw=spec.cloud_rmw,
        user_id=user if user is not None and user <= _HIGHEST_USER else 1000,
        labels={"org.opencontainers.image.source": build.git.url},
    )
