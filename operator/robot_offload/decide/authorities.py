"""Where the keys of a RobotOffload's authorities are: in the operator's own namespace.

Who may read Secrets beside the robots, or run pods there, then finds leaves only: no key that signs further ones. No
owner reference reaches into another namespace, so these Secrets name their RobotOffload by uid, and the operator
collects them when it is gone.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, Literal, TypeAlias

from robot_offload.decide.ownership import Key
from robot_offload.kube.kinds import SECRET
from robot_offload.kube.port import Manifest
from robot_offload.objects import labels, names
from robot_offload.objects.parent import Parent

Authority: TypeAlias = Literal["server-ca", "client-ca"]
AUTHORITIES: Final[tuple[Authority, ...]] = ("server-ca", "client-ca")
SERVES: Final = "robotoffload.dev/serves"
"""Annotation on these Secrets: `<namespace>/<name>` of the RobotOffload."""


def secret_names(uid: str) -> dict[Authority, str]:
    """Returns the names of the Secrets of the RobotOffload with this uid."""
    return {role: f"{role}-{uid}" for role in AUTHORITIES}


def uid_of(secret: str) -> str:
    """Returns the uid of the RobotOffload whose Secret has this name; empty: the name is none of ours."""
    found = [secret.removeprefix(f"{role}-") for role in AUTHORITIES if secret.startswith(f"{role}-")]
    return found[0] if found else ""


def serves(secret: Manifest) -> tuple[str, str] | None:
    """Returns namespace and name of the RobotOffload that an authority's Secret serves; None: it is not one."""
    text = str((secret["metadata"].get("annotations") or {}).get(SERVES) or "")
    namespace, _, name = text.partition("/")
    return (namespace, name) if namespace and name and uid_of(secret["metadata"]["name"]) else None


def former_keys(offload: str) -> dict[Authority, Key]:
    """Returns where earlier versions of the operator kept them: beside the robot."""
    return {role: (SECRET, names.child_name(offload, role)) for role in AUTHORITIES}


def secret(parent: Parent, role: Authority, data: Mapping[str, str], annotations: Mapping[str, str]) -> Manifest:
    """Returns the Secret of an authority; `data` is in base64."""
    return {
        "apiVersion": SECRET.api_version,
        "kind": SECRET.kind,
        "metadata": {
            "name": secret_names(parent.uid)[role],
            "namespace": parent.facts.home,
            "labels": {
                labels.NAME: labels.MANAGER,
                labels.COMPONENT: "certificates",
                labels.MANAGED_BY: labels.MANAGER,
            },
            "annotations": {SERVES: f"{parent.namespace}/{parent.name}", **annotations},
        },
        "type": "kubernetes.io/tls",
        "data": dict(data),
    }
