"""The Job that builds a node's image: fetch the source, build, push; each with only the rights that it needs.

decisions/0007 explains why it is buildah, and why the build's container cannot keep to the restricted level.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from robot_offload.api.v1alpha1 import NodeBuild, Registry, RobotOffloadSpec
from robot_offload.kube.kinds import CONFIG_MAP, JOB
from robot_offload.kube.port import Manifest
from robot_offload.objects import pod
from robot_offload.objects.facts import Facts
from robot_offload.objects.parent import Parent, Part
from robot_offload.render import build_scripts as scripts

FETCH: Final = "fetch"
BUILD: Final = "build"
PUSH: Final = "push"
DEADLINE_S: Final = 7200
"""Maximum seconds of one build."""
KEPT_S: Final = 3600
"""Seconds for which an ended Job is kept: for reading its log, and, if it failed, until the next try."""
BUILDER_USER: Final = 1000
"""The user of the builder's image that may use further user ids."""
_FETCH_USER: Final = 65534
"""The user `nobody`: every base image has an entry for it, which ssh requires."""
_WEB_PORTS: Final = (80, 443)
_SSH_PORT: Final = 22


@dataclass(frozen=True, slots=True)
class BuildPlan:
    """One image to build.

    Attributes:
        nodes: that use the image.
        build: its `build` block.
        registry: its target.
        key: short name for everything from which it is made, except the commit.
        name: of the Job, and of the ConfigMap beside it.
        dockerfile: for the folder with the source.
        placed: labels of the cluster's nodes on which it must be built: an image is for one architecture.
    """

    nodes: tuple[str, ...]
    build: NodeBuild
    registry: Registry
    key: str
    name: str
    dockerfile: str
    placed: Mapping[str, str] = field(default_factory=dict)

    @property
    def repository(self) -> str:
        """The target of the push, without tag."""
        return f"{self.registry.repository}/{self.build.package}"


def build_files(parent: Parent, plan: BuildPlan) -> Manifest:
    """Return the ConfigMap with the build's files. It never changes: another build has another name."""
    host = plan.registry.repository.partition("/")[0]
    # A JSON text is a TOML text as well.
    registries = ['unqualified-search-registries = ["docker.io"]', 'short-name-mode = "permissive"']
    if plan.registry.insecure:
        registries += ["[[registry]]", f"location = {json.dumps(host)}", "insecure = true"]
    body = {
        "immutable": True,
        "data": {scripts.DOCKERFILE: plan.dockerfile, scripts.REGISTRIES: "\n".join(registries) + "\n"},
    }
    return parent.child(CONFIG_MAP, Part(plan.name, "build"), body)


def build_job(parent: Parent, plan: BuildPlan) -> Manifest:
    """Return the Job. A failed pod is final, unless it was evicted: the same source would fail again."""
    spec = {
        "backoffLimit": 0,
        "activeDeadlineSeconds": DEADLINE_S,
        "ttlSecondsAfterFinished": KEPT_S,
        "podFailurePolicy": {
            "rules": [{"action": "Ignore", "onPodConditions": [{"type": "DisruptionTarget", "status": "True"}]}]
        },
        "template": _template(parent, plan),
    }
    return parent.child(JOB, Part(plan.name, "build"), {"spec": spec})


def build_ports(spec: RobotOffloadSpec) -> tuple[int, ...]:
    """Return the TCP ports on which builds reach sources, packages, base images and the registry."""
    ports = set(_WEB_PORTS)
    registries = [spec.cloud.registry.repository] if spec.cloud.registry else []
    for node in spec.built_nodes:
        if node.build is not None:
            ports |= _git_port(node.build)
            registries += [image for image in (node.build.base, node.build.runtime_base) if image and "/" in image]
    for registry in registries:
        port = registry.partition("/")[0].partition(":")[2]
        ports |= {int(port)} if port else set()
    return tuple(sorted(ports))


def _git_port(build: NodeBuild) -> set[int]:
    found = re.match(r"(?:https|ssh)://(?:[^/@]*@)?[^/:]+:([0-9]+)(?:/|$)", build.git.url)
    if found:
        return {int(found[1])}
    return {_SSH_PORT} if build.git.over_ssh else set()


def _template(parent: Parent, plan: BuildPlan) -> Manifest:
    return pod.pod_template(
        parent,
        Part(plan.name, "build"),
        [_push(parent.facts, plan)],
        read=plan.key,
        grace_s=5,
        volumes=_volumes(plan),
        extra={
            "initContainers": [_fetch(parent.facts, plan), _build(parent.facts, plan)],
            "restartPolicy": "Never",
            "nodeSelector": dict(plan.placed),
            "securityContext": {"runAsNonRoot": True, "fsGroup": BUILDER_USER},
        },
    )


def _volumes(plan: BuildPlan) -> list[Manifest]:
    found: list[Manifest] = [
        {"name": "scratch", "emptyDir": {}},
        {"name": "unpacked", "emptyDir": {}},
        pod.config_map_volume("files", plan.name, [scripts.DOCKERFILE, scripts.REGISTRIES]),
    ]
    if plan.build.git_secret is not None:
        keys = scripts.SSH_KEYS if plan.build.git.over_ssh else scripts.TOKEN_KEYS
        volume = _secret_volume("git", plan.build.git_secret.name, {key: key for key in keys})
        # Without known_hosts the script reports what is missing; the kubelet would silently wait for it.
        found.append({**volume, "secret": {**volume["secret"], "optional": True}})
    for name, secret in (("push-secret", plan.registry.push_secret), ("pull-secret", plan.registry.pull_secret)):
        if secret is not None:
            found.append(_secret_volume(name, secret.name, {".dockerconfigjson": scripts.AUTH_FILE}))
    return found


def _secret_volume(name: str, secret: str, files: Mapping[str, str]) -> Manifest:
    """Mount only some entries of a Secret: its other entries are of no concern here."""
    items = [{"key": key, "path": path} for key, path in files.items()]
    return {"name": name, "secret": {"secretName": secret, "defaultMode": 0o440, "items": items}}


def _fetch(facts: Facts, plan: BuildPlan) -> Manifest:
    """Fetch one commit. No user chooses this image, because it sees the source's Secret. Keep to `restricted`."""
    mounts = [pod.mount("scratch", scripts.SCRATCH, read_only=False)]
    if plan.build.git_secret is not None:
        mounts.append(pod.mount("git", scripts.GIT_SECRET_DIR))
    environment = {
        "GIT_URL": plan.build.git.url,
        "GIT_REF": plan.build.git.ref,
        "GIT_PATHS": "\n".join(plan.build.git.paths),
    }
    security = {
        "runAsUser": _FETCH_USER,
        "runAsGroup": _FETCH_USER,
        "allowPrivilegeEscalation": False,
        "capabilities": {"drop": ["ALL"]},
        "readOnlyRootFilesystem": True,
        "seccompProfile": {"type": "RuntimeDefault"},
    }
    return _container(FETCH, facts.images.git, scripts.FETCH, plan, environment, mounts, security)


def _build(facts: Facts, plan: BuildPlan) -> Manifest:
    return _buildah(BUILD, facts, plan, scripts.BUILD, "pull-secret" if plan.registry.pull_secret else None)


def _push(facts: Facts, plan: BuildPlan) -> Manifest:
    unpacked = pod.mount("unpacked", scripts.UNPACKED_DIR, read_only=False)
    return _buildah(PUSH, facts, plan, scripts.PUSH, "push-secret" if plan.registry.push_secret else None, unpacked)


def _buildah(
    name: str, facts: Facts, plan: BuildPlan, script: str, secret: str | None, *more_mounts: Manifest
) -> Manifest:
    mounts = [
        pod.mount("scratch", scripts.SCRATCH, read_only=False),
        pod.mount("files", scripts.FILES_DIR),
        *more_mounts,
    ]
    if secret is not None:
        mounts.append(pod.mount(secret, scripts.REGISTRY_SECRET_DIR))
    environment = {"REPOSITORY": plan.repository, "KEY": plan.key}
    return _container(name, facts.images.builder, script, plan, environment, mounts, _BUILDAH_SECURITY)


# newuidmap and newgidmap make a user namespace with their file capabilities: no_new_privs and an empty bounding set
# would remove them; and the default seccomp and AppArmor profiles forbid unshare and mount to anyone but root.
_BUILDAH_SECURITY: Final[Mapping[str, Any]] = {
    "runAsUser": BUILDER_USER,
    "runAsGroup": BUILDER_USER,
    "allowPrivilegeEscalation": True,
    "capabilities": {"drop": ["ALL"], "add": ["SETUID", "SETGID"]},
    "readOnlyRootFilesystem": True,
    "seccompProfile": {"type": "Unconfined"},
    "appArmorProfile": {"type": "Unconfined"},
}


def _container(
    name: str,
    image: str,
    script: str,
    plan: BuildPlan,
    environment: Mapping[str, str],
    mounts: Sequence[Manifest],
    security: Mapping[str, Any],
) -> Manifest:
    limits, requests = plan.build.resources.limits, plan.build.resources.requests
    return pod.container(
        name,
        image,
        [script],
        environment=environment,
        mounts=mounts,
        resources={key: dict(them) for key, them in (("limits", limits), ("requests", requests)) if them},
        extra={
            "command": ["/bin/sh", "-c"],
            "terminationMessagePolicy": "FallbackToLogsOnError",
            "securityContext": dict(security),
        },
    )
