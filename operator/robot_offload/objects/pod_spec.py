"""Merges the pod settings of users and administrators into our pods."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from robot_offload.api.strict_yaml import thaw
from robot_offload.kube.port import Manifest

_ADDED: Final = ("resourceClaims", "tolerations", "topologySpreadConstraints", "volumes")
"""Lists that are appended to ours."""


def laid_over(pod: Manifest, *parts: Mapping[str, Any]) -> Manifest:
    """Return a pod's specification overridden by further parts, in their order.

    Containers and their mounts are identified by name: an entry for a container that this pod lacks is ignored.

    Args:
        pod: as we make it.
        parts: as checked by `api.v1alpha1.pod_spec`.
    """
    for part in parts:
        if part:
            pod = _over(pod, part)
    return pod


def _over(pod: Manifest, part: Mapping[str, Any]) -> Manifest:
    result = dict(pod)
    for field, value in part.items():
        if field == "containers":
            continue
        plain: Any = thaw(value)
        result[field] = [*pod.get(field, ()), *plain] if field in _ADDED else plain
    for field in ("containers", "initContainers"):
        if field in pod:
            named = {str(one["name"]): one for one in part.get("containers", ())}
            result[field] = [_container(one, named.get(one["name"], {})) for one in pod[field]]
    return result


def _container(ours: Manifest, part: Mapping[str, Any]) -> Manifest:
    result = dict(ours)
    if part.get("volumeMounts"):
        result["volumeMounts"] = [*ours.get("volumeMounts", ()), *_plain(part["volumeMounts"])]
    if part.get("resources"):
        before = ours.get("resources") or {}
        result["resources"] = {**before, **{key: _both(before.get(key), of) for key, of in part["resources"].items()}}
    return result


def _both(before: Any, after: Any) -> Any:
    if isinstance(after, Mapping) and isinstance(before, Mapping):
        return {**before, **_plain(after)}
    return _plain(after)


def _plain(value: object) -> Any:
    return thaw(value)
