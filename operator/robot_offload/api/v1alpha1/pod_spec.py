"""The part of a pod's specification that users may write themselves, in Kubernetes' own words.

One block instead of many fields of ours: what is in it goes to the API server as it is, which knows its fields best.
Left out is what would give a pod more rights than its namespace's users have through it: the host, another identity,
another program.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Annotated, Any, Final

from pydantic import BeforeValidator, WithJsonSchema

FIELDS: Final = (
    "affinity",
    "containers",
    "dnsConfig",
    "priorityClassName",
    "resourceClaims",
    "schedulerName",
    "tolerations",
    "topologySpreadConstraints",
    "volumes",
)
CONTAINER_FIELDS: Final = ("name", "resources", "volumeMounts")
CONTAINERS: Final = ("agent", "build", "discovery", "fetch", "node", "push", "reporter", "router", "tunnel")
"""All containers of our pods; `node` is the user's own."""
VOLUME_SOURCES: Final = ("configMap", "emptyDir", "ephemeral", "image", "persistentVolumeClaim")
"""Neither the host nor Secrets: variables name those."""
VOLUMES: Final = (
    *("certificates", "configuration", "files", "git", "parameters", "pull-secret", "push-secret", "runtime"),
    *("scratch", "settings", "state", "tmp", "token", "unpacked"),
)
"""Names of volumes that our pods have."""
DIRECTORIES: Final = ("/etc/robot-offload", "/run/robot-offload", "/tmp", "/var/lib/robot-offload", "/var/run/secrets")  # noqa: S108 - no file is made
"""Where our containers mount theirs."""


def check_pod_spec(value: Any) -> Any:
    """Return a part of a pod's specification as it is.

    Raises:
        ValueError: it has a field that is not allowed, or names a container or volume that it must not.
    """
    part = _mapping(value, "a mapping with fields of a pod's specification")
    _known("", part, FIELDS)
    own = {str(volume.get("name")) for volume in _volumes(part)}
    for container in _entries(part, "containers"):
        name = str(container.get("name"))
        _known(f"containers[{name}].", container, CONTAINER_FIELDS)
        if name not in CONTAINERS:
            raise ValueError(f"containers: there is no container {name!a}; there are {', '.join(CONTAINERS)}")
        _mapping(container.get("resources", {}), f"containers[{name}].resources must be a mapping")
        for mount in _entries(container, "volumeMounts"):
            _check_mount(name, mount, own)
    for field in ("tolerations", "topologySpreadConstraints", "resourceClaims"):
        list(_entries(part, field))
    return value


def _volumes(part: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    for volume in _entries(part, "volumes"):
        name = str(volume.get("name"))
        if name in VOLUMES:
            raise ValueError(f"volumes: {name} is the name of a volume of ours; choose another one")
        _known(f"volumes[{name}].", volume, ("name", *VOLUME_SOURCES))
        yield volume


def _check_mount(container: str, mount: Mapping[str, Any], own: set[str]) -> None:
    name, path = str(mount.get("name")), str(mount.get("mountPath"))
    if name not in own:
        raise ValueError(f"containers[{container}].volumeMounts: {name!a} is not among the volumes of this block")
    if path == "/" or ".." in path or any(f"{path}/".startswith(f"{ours}/") for ours in DIRECTORIES):
        raise ValueError(
            f"containers[{container}].volumeMounts: {path!a} would hide files of ours; choose another path"
        )


def _known(where: str, part: Mapping[str, Any], allowed: Iterable[str]) -> None:
    for field in part:
        if field not in allowed:
            raise ValueError(f"{where}{str(field)[:40]} is not a field that can be set here; {', '.join(allowed)} can")


def _entries(part: Mapping[str, Any], field: str) -> Iterator[Mapping[str, Any]]:
    listed = part.get(field, ())
    if not isinstance(listed, tuple | list) or not all(isinstance(entry, Mapping) for entry in listed):
        raise ValueError(f"{field} must be a list of mappings")
    yield from listed


def _mapping(value: Any, what: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise ValueError(f"must be {what}" if not what.endswith("mapping") else what)
    return value


PodSpec = Annotated[
    dict[str, Any],
    BeforeValidator(check_pod_spec),
    WithJsonSchema({"type": "object", "x-kubernetes-preserve-unknown-fields": True}),
]
"""Fields of a pod's specification in Kubernetes' own words, see `FIELDS`."""
