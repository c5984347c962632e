"""The owner of an object. Names never decide that: a foreign object may have the name of one of our children."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, TypeAlias

from robot_offload.kube.kinds import Kind, kind_of
from robot_offload.kube.port import Manifest

APPLIED: Final = "robotoffload.dev/applied"
"""Annotation on every child: `<uid of the RobotOffload>/<digest of what was applied>`."""

Key: TypeAlias = tuple[Kind, str]
"""A child within its RobotOffload's namespace: kind and name."""


def key_of(manifest: Manifest) -> Key:
    """Return the key of a child."""
    return kind_of(manifest), manifest["metadata"]["name"]


def described(manifest: Manifest) -> str:
    """Return an object in words: `Deployment wheelchair-agent`."""
    return f"{manifest['kind']} {manifest['metadata']['name']}"


def controller_of(manifest: Manifest) -> Mapping[str, Any] | None:
    """Return the owner reference that controls the object, if any."""
    for reference in manifest["metadata"].get("ownerReferences") or ():
        if reference.get("controller"):
            return dict(reference)
    return None


def belongs(manifest: Manifest, uid: str) -> bool:
    """Return whether the object is a child of the RobotOffload with this uid.

    The owner reference decides. If it was removed, our own annotation does, so that the child is repaired and not
    reported as foreign.
    """
    owner = controller_of(manifest)
    if owner is not None:
        return owner.get("uid") == uid
    annotations = manifest["metadata"].get("annotations") or {}
    return str(annotations.get(APPLIED, "")).partition("/")[0] == uid


def owner_described(manifest: Manifest) -> str:
    """Return the owner of an object, in words."""
    owner = controller_of(manifest)
    return f"belongs to {owner.get('kind')} {owner.get('name')}" if owner else "has no owner"


def being_deleted(manifest: Manifest) -> bool:
    """Return whether the object is being deleted."""
    return bool(manifest["metadata"].get("deletionTimestamp"))
