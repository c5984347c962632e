"""The replicas of the application's nodes in the cloud: one Deployment per node, with one pod or a pool."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from robot_offload import transport
from robot_offload.api.v1alpha1 import EnvironmentVariable, Node, RobotOffloadSpec
from robot_offload.kube.port import Manifest
from robot_offload.objects import labels, pod
from robot_offload.objects.facts import Facts
from robot_offload.objects.hashes import config_hash
from robot_offload.objects.names import AGENT, PARAMETERS, child_name, node_child
from robot_offload.objects.parent import Parent, Part
from robot_offload.render import dds_profile, handover, pool
from robot_offload.render.parameter_files import RenamedFile, renamed_files
from robot_offload.render.ros_names import command

PARAMETERS_DIR: Final = "/etc/robot-offload/parameters"
CONTAINER: Final = "node"
MISSING_IMAGE: Final = "image-not-given"
"""Placeholder for a missing image; the checks refuse such a specification before it comes to a cluster."""


def node_deployments(parent: Parent) -> tuple[Manifest, ...]:
    """Return the Deployments of all nodes with a cloud replica, in bring-up order; nodes without an image have none."""
    images = ((node, _image(parent.facts, node)) for node in parent.spec.cloud_nodes)
    files = renamed_files(parent.spec, parent.facts.user_configs)
    return tuple(_deployment(parent, node, image, files) for node, image in images if image is not None)


def _image(facts: Facts, node: Node) -> str | None:
    """Return the image of a node; None: it is not built yet."""
    return facts.built.get(node.name) if node.build is not None else node.image or MISSING_IMAGE


def replicas(spec: RobotOffloadSpec, node: Node, facts: Facts) -> int:
    """Return a node's number of pods: none without a robot, and none of a Cold node that the robot cannot use now."""
    if not facts.nodes_wanted or spec.replicas == 0:
        return 0
    if node.duplicated and node.standby.cloud == "Cold":
        usable = spec.switching.pin != "Robot" and spec.switching.mode == "Auto"
        return int(facts.robot_connected and usable)
    return node.replicas or 1


def _deployment(parent: Parent, node: Node, image: str, files: Mapping[str, RenamedFile]) -> Manifest:
    name = node_child(parent.name, node.name)
    part = Part(name, "node", {labels.NODE: name})
    volumes, mounts, params_file = _parameter_file(parent, node, files)
    extra: Manifest = {}
    if node.duplicated or node.most_pods:
        extra["lifecycle"] = pool.pre_stop() if node.most_pods else handover.pre_stop()
    if node.image_pull_policy is not None:
        extra["imagePullPolicy"] = node.image_pull_policy
    container = pod.container(
        CONTAINER,
        image,
        _args(parent, node, params_file),
        environment=_environment(parent, node),
        mounts=[*mounts, *dds_profile.mounts(parent.offload)],
        resources={
            key: dict(values)
            for key, values in (("limits", node.resources.limits), ("requests", node.resources.requests))
            if values
        },
        extra=extra,
    )
    placed: Manifest = {"nodeSelector": dict(node.node_selector)}
    if node.runtime_class_name is not None:
        placed["runtimeClassName"] = node.runtime_class_name
    template = pod.pod_template(
        parent,
        part,
        [container],
        read=config_hash(_read_at_start(node, parent.facts)),
        grace_s=pool.grace_s(node) if node.most_pods else handover.GRACE_S,
        volumes=[*volumes, *dds_profile.volumes(parent.offload)],
        extra=placed,
        own=node.pod_spec,
    )
    count = replicas(parent.spec, node, parent.facts)
    return pod.deployment(parent, part, template, replicas=count, most=node.most_pods)


def _args(parent: Parent, node: Node, params_file: str | None) -> list[str]:
    words = command(parent.spec, node, "cloud", params_file=params_file) if node.run else ()
    return [pod.literal(word) for word in (pool.named(words) if node.most_pods else words)]


def _environment(parent: Parent, node: Node) -> dict[str, str | Manifest]:
    own: dict[str, str | Manifest] = {
        **pod.ros_environment(parent.offload),
        **transport.of(parent.spec).node_environment(parent),
        **dds_profile.environment(parent.offload),
    }
    if node.duplicated:
        own[handover.URL_VARIABLE] = handover.url(child_name(parent.name, AGENT), parent.uid)
    if node.most_pods:
        own |= pool.environment(node, child_name(parent.name, AGENT), parent.uid)
    # We decide where the node belongs; a user may set everything else, such as HOME.
    fixed = {name: value for name, value in own.items() if name not in ("HOME", "ROS_LOG_DIR")}
    return {**own, **{one.name: _value(one) for one in node.env}, **fixed}


def _value(variable: EnvironmentVariable) -> str | Manifest:
    """Return the value of a variable, or where Kubernetes reads it when the pod starts."""
    source = variable.value_from
    if source is None:
        return pod.literal(variable.value)
    if source.secret_key_ref is not None:
        return {"secretKeyRef": {"name": source.secret_key_ref.name, "key": source.secret_key_ref.key}}
    assert source.config_map_key_ref is not None  # ensured by a rule
    return {"configMapKeyRef": {"name": source.config_map_key_ref.name, "key": source.config_map_key_ref.key}}


def _parameter_file(
    parent: Parent, node: Node, files: Mapping[str, RenamedFile]
) -> tuple[list[Manifest], list[Manifest], str | None]:
    """Return volumes, mounts and path of a user's parameter file in a ConfigMap."""
    if node.run is None or node.run.parameters_from is None:
        return [], [], None
    reference = node.run.parameters_from.config_map_key_ref
    volume = pod.config_map_volume("parameters", reference.name, [reference.key])
    if node.duplicated:
        shared = files.get(f"{reference.name}/{reference.key}")
        if shared is not None:
            items = [{"key": shared.key, "path": reference.key}]
            volume = {"name": "parameters", "configMap": {"name": _shared(parent).name, "items": items}}
    return [volume], [pod.mount("parameters", PARAMETERS_DIR)], f"{PARAMETERS_DIR}/{reference.key}"


def parameter_copies(parent: Parent) -> tuple[Manifest, ...]:
    """Return the ConfigMap with the parameter files of all replicas, see `parameter_files`; none without files."""
    files = renamed_files(parent.spec, parent.facts.user_configs)
    return (parent.config_map(_shared(parent), {file.key: file.text for file in files.values()}),) if files else ()


def _shared(parent: Parent) -> Part:
    return Part(child_name(parent.name, PARAMETERS), "node")


def _read_at_start(node: Node, facts: Facts) -> str:
    """Return the hash of the node's parameter file; everything else that it reads is in the template."""
    if node.run is None or node.run.parameters_from is None:
        return ""
    reference = node.run.parameters_from.config_map_key_ref
    return facts.user_config_hashes.get(f"{reference.name}/{reference.key}", "")
