"""Parts of pods: what the restricted Pod Security level of a namespace requires, and what all our pods share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from robot_offload.api.v1alpha1 import CloudSide, RobotOffload, Toleration
from robot_offload.kube.kinds import DEPLOYMENT
from robot_offload.kube.port import Manifest
from robot_offload.objects import hashes, labels
from robot_offload.objects.parent import Parent, Part
from robot_offload.objects.pod_spec import laid_over

TMP: Final = "/tmp"  # noqa: S108 - an emptyDir of the pod's own, mounted because the root file system is read-only
CERTIFICATES_DIR: Final = "/etc/robot-offload/certificates"


def pod_template(
    parent: Parent,
    part: Part,
    containers: Sequence[Manifest],
    *,
    read: str,
    grace_s: int,
    volumes: Sequence[Manifest] = (),
    extra: Mapping[str, Any] | None = None,
    own: Mapping[str, Any] | None = None,
) -> Manifest:
    """Return the template of a pod.

    Args:
        parent: owner of the pod.
        part: of the pod.
        containers: as built by `container`.
        read: hash of what its containers read at their start, see `hashes`.
        grace_s: seconds between the request to stop it and the kill.
        volumes: beside the one for /tmp.
        extra: further fields of the pod's specification; a `nodeSelector` overrides that of spec.cloud.
        own: the user's fields for this pod alone, which override those for all pods.
    """
    cloud = parent.spec.cloud
    further = dict(extra or {})
    node_selector = {**cloud.node_selector, **further.pop("nodeSelector", {})}
    spec: Manifest = {
        # Only an intruder could use the token; the reporter mounts its own.
        "automountServiceAccountToken": False,
        "enableServiceLinks": False,
        "securityContext": _pod_security(cloud),
        "terminationGracePeriodSeconds": grace_s,
        "containers": list(containers),
        "volumes": [{"name": "tmp", "emptyDir": {}}, *volumes],
        **further,
    }
    if node_selector:
        spec["nodeSelector"] = node_selector
    if cloud.tolerations:
        spec["tolerations"] = [_toleration(one) for one in cloud.tolerations]
    pull_secrets = dict.fromkeys((*(one.name for one in cloud.image_pull_secrets), *parent.facts.pull_secrets))
    if pull_secrets:
        spec["imagePullSecrets"] = [{"name": name} for name in pull_secrets]
    return {
        "metadata": {
            "labels": {**labels.labels(parent.offload, part.component), **part.own},
            "annotations": {hashes.ANNOTATION: read},
        },
        "spec": laid_over(spec, parent.facts.pod_spec, cloud.pod_spec, own or {}),
    }


def container(
    name: str,
    image: str,
    args: Sequence[str],
    *,
    environment: Mapping[str, str | Manifest],
    mounts: Sequence[Manifest] = (),
    resources: Mapping[str, Any] | None = None,
    extra: Mapping[str, Any] | None = None,
) -> Manifest:
    """Return a container. `args`, no command: the image's entry point prepares the ROS environment.

    Args:
        name: of the container.
        image: of the container.
        args: the command that its entry point runs.
        environment: values, or where Kubernetes reads them (`valueFrom`), by variable name.
        mounts: beside /tmp.
        resources: requests and limits.
        extra: further fields.
    """
    result: Manifest = {
        "name": name,
        "image": image,
        "args": list(args),
        "env": [
            {"name": key, "value" if isinstance(value, str) else "valueFrom": value}
            for key, value in environment.items()
        ],
        "securityContext": {
            "allowPrivilegeEscalation": False,
            "capabilities": {"drop": ["ALL"]},
            "readOnlyRootFilesystem": True,
        },
        "volumeMounts": [{"name": "tmp", "mountPath": TMP}, *mounts],
        **(extra or {}),
    }
    if resources:
        result["resources"] = dict(resources)
    return result


def literal(text: str) -> str:
    """Return a user's text escaped for args and env: the kubelet expands `$(NAME)` and makes `$` of `$$`."""
    return text.replace("$", "$$")


def deployment(parent: Parent, part: Part, template: Manifest, *, replicas: int = 1, most: int = 0) -> Manifest:
    """Return a Deployment.

    Args:
        parent: owner of the Deployment.
        part: of the Deployment.
        template: of its pods.
        replicas: number of pods.
        most: 0: one pod at most, the old one is gone before the new one starts. Otherwise the pods are a pool that may
            overlap, and an autoscaler may request up to this many.
    """
    strategy: Manifest = {"type": "Recreate"}
    if most:
        # Explicit: the API server's default would stay when the node is no longer a pool, and would then be refused.
        strategy = {"type": "RollingUpdate", "rollingUpdate": {"maxSurge": "25%", "maxUnavailable": "25%"}}
    body = {
        "replicas": replicas,
        "revisionHistoryLimit": 2,
        # A pod that keeps dying within these seconds is not reported as available in between.
        "minReadySeconds": 3,
        "strategy": strategy,
        "selector": {"matchLabels": parent.selector(part)},
        "template": template,
    }
    annotations = {labels.MOST_PODS: str(most)} if most > max(replicas, 1) else None
    return parent.child(DEPLOYMENT, part, {"spec": body}, annotations)


def ros_environment(offload: RobotOffload) -> dict[str, str]:
    """Return the environment of everything that speaks ROS 2 in the cloud."""
    return {
        "ROS_DOMAIN_ID": str(offload.spec.cloud_domain_id),
        "RMW_IMPLEMENTATION": offload.spec.cloud_rmw,
        # Each pod has its own /dev/shm but may look like the same host: shared memory would match and deliver nothing.
        "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4",
        "HOME": TMP,
        "ROS_LOG_DIR": TMP,
    }


def config_map_volume(name: str, config_map: str, keys: Sequence[str]) -> Manifest:
    """Return a volume with chosen keys of a ConfigMap as files."""
    return {"name": name, "configMap": {"name": config_map, "items": [{"key": key, "path": key} for key in keys]}}


def certificates_volume(secret: str) -> Manifest:
    """Return a volume with a certificate, readable by the pod's group only."""
    return {"name": "certificates", "secret": {"secretName": secret, "defaultMode": 0o440}}


def listens(port: int, protocol: str = "tcp") -> Manifest:
    """Return a readiness probe: whether a port of the pod is open.

    It makes no connection. An empty connection is a failed handshake, at which the programs behind these ports stop.

    Args:
        port: its number.
        protocol: `tcp` or `udp`.
    """
    # The columns of /proc/net: local address, remote address, state. 0A: listening.
    line = f":{port:04X} 00000000:0000 0A" if protocol == "tcp" else f":{port:04X} "
    command = ["grep", "-q", line, f"/proc/net/{protocol}"]
    return {"exec": {"command": command}, "periodSeconds": 5, "timeoutSeconds": 2}


def mount(name: str, path: str, *, read_only: bool = True) -> Manifest:
    """Mount a volume in a container: a whole folder, as a single file would never be refreshed."""
    return {"name": name, "mountPath": path, "readOnly": True} if read_only else {"name": name, "mountPath": path}


def _pod_security(cloud: CloudSide) -> Manifest:
    result: Manifest = {"runAsNonRoot": True, "seccompProfile": {"type": "RuntimeDefault"}}
    if cloud.run_as_user is not None:
        # The group lets a process that is not root read its private key.
        result |= {"runAsUser": cloud.run_as_user, "runAsGroup": cloud.run_as_user, "fsGroup": cloud.run_as_user}
    return result


def _toleration(toleration: Toleration) -> Manifest:
    fields = {
        "key": toleration.key,
        "operator": toleration.operator,
        "value": toleration.value,
        "effect": toleration.effect,
        "tolerationSeconds": toleration.toleration_seconds,
    }
    return {name: value for name, value in fields.items() if value is not None}
