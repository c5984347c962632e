"""Where the keys of a RobotOffload's authorities are kept: in the operator's own namespace.

A user who may read Secrets beside the robots, or run pods there, then finds only leaves: no key that signs further
ones. Owner references do not reach into another namespace, so these Secrets name their RobotOffload by uid, and the
operator deletes them when it is gone.

Not at once: a RobotOffload that is deleted and applied again, restored or moved is another object of the same name, but
its robot has the old one's certificates. So the keys outlive it for a time, and the next RobotOffload of that namespace
and name adopts them.
"""

from __future__ import annotations

import datetime
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Final, Literal, TypeAlias

from robot_offload.decide.ownership import Key
from robot_offload.kube.kinds import SECRET
from robot_offload.kube.port import Manifest
from robot_offload.objects import labels, names
from robot_offload.objects.parent import Parent

Authority: TypeAlias = Literal["server-ca", "client-ca"]
AUTHORITIES: Final[tuple[Authority, ...]] = ("server-ca", "client-ca")
IDENTITY: Final = "robotoffload.dev/identity"
"""Annotation on these Secrets and on the robot's: the uid by which the robot knows its cloud, if that is not its
RobotOffload's but that of an earlier one of the same name."""
ORPHANED: Final = "robotoffload.dev/orphaned"
"""Annotation on these Secrets: the RFC 3339 time since which their RobotOffload is gone."""
KEEP: Final = datetime.timedelta(days=30)
"""How long keys outlive their RobotOffload, unless configured otherwise."""
KEPT_MOST: Final = 100
"""Maximum of kept robots' keys without a RobotOffload, by namespace: users who may write RobotOffloads must not be able
to fill the operator's namespace."""
LABELS: Final = {
    labels.NAME: labels.MANAGER,
    labels.COMPONENT: "certificates",
    labels.MANAGED_BY: labels.MANAGER,
}
SERVES: Final = "robotoffload.dev/serves"
"""Annotation on these Secrets: `<namespace>/<name>` of the RobotOffload."""


def secret_names(uid: str) -> dict[Authority, str]:
    """Return the names of the Secrets of the RobotOffload with this uid."""
    return {role: f"{role}-{uid}" for role in AUTHORITIES}


def uid_of(secret: str) -> str:
    """Return the uid of the RobotOffload whose Secret has this name; empty: not such a name."""
    found = [secret.removeprefix(f"{role}-") for role in AUTHORITIES if secret.startswith(f"{role}-")]
    return found[0] if found else ""


def serves(secret: Manifest) -> tuple[str, str] | None:
    """Return namespace and name of the RobotOffload that an authority's Secret serves; None: it is another Secret."""
    text = str((secret["metadata"].get("annotations") or {}).get(SERVES) or "")
    namespace, _, name = text.partition("/")
    return (namespace, name) if namespace and name and uid_of(secret["metadata"]["name"]) else None


def identity_of(secret: Manifest | None) -> str:
    """Return the uid by which the robot knows its cloud; empty: its RobotOffload's uid."""
    return str(((secret or {}).get("metadata", {}).get("annotations") or {}).get(IDENTITY) or "")


def heritage(secrets: Iterable[Manifest], parent: Parent) -> str:
    """Return the uid of the earlier RobotOffload whose keys this one adopts; empty: there is none.

    Of several the youngest, which adopted those of the others. A name has one object at a time, so every other one that
    served it is gone.

    Args:
        secrets: those in the operator's namespace, without their data.
        parent: the RobotOffload that has no keys yet.
    """
    place = (parent.namespace, parent.name)
    former = [one for one in secrets if serves(one) == place and uid_of(one["metadata"]["name"]) != parent.uid]
    whole = [uid for uid, one in _by_uid(former).items() if len(one) == len(AUTHORITIES)]
    made = {uid_of(one["metadata"]["name"]): str(one["metadata"].get("creationTimestamp")) for one in former}
    return max(whole, key=lambda uid: made[uid], default="")


def expired(secrets: Iterable[Manifest], keep: datetime.timedelta, now: datetime.datetime) -> list[Manifest]:
    """Return the Secrets of deleted RobotOffloads that expired: too old, or too many of one namespace.

    Args:
        secrets: of deleted RobotOffloads, each with the annotation `ORPHANED`.
        keep: how long they outlive their RobotOffload.
        now: our wall clock, with its time zone.
    """
    groups = sorted(_by_uid(secrets).values(), key=lambda group: _orphaned(group[0]), reverse=True)
    kept: Counter[str] = Counter()
    found: list[Manifest] = []
    for group in groups:
        place = (serves(group[0]) or ("", ""))[0]
        kept[place] += 1
        if kept[place] > KEPT_MOST or now - _orphaned(group[0]) >= keep:
            found += group
    return found


def _orphaned(secret: Manifest) -> datetime.datetime:
    """Return since when the RobotOffload of a Secret is gone; an unreadable time counts as long ago."""
    try:
        found = datetime.datetime.fromisoformat(str(secret["metadata"]["annotations"][ORPHANED]))
    except ValueError:
        return datetime.datetime.min.replace(tzinfo=datetime.UTC)
    return found if found.tzinfo is not None else found.replace(tzinfo=datetime.UTC)


def _by_uid(secrets: Iterable[Manifest]) -> dict[str, list[Manifest]]:
    found: dict[str, list[Manifest]] = {}
    for one in secrets:
        found.setdefault(uid_of(one["metadata"]["name"]), []).append(one)
    return found


def former_keys(offload: str) -> dict[Authority, Key]:
    """Return where earlier versions of the operator kept the keys: beside the robot."""
    return {role: (SECRET, names.child_name(offload, role)) for role in AUTHORITIES}


def secret(parent: Parent, role: Authority, data: Mapping[str, str], annotations: Mapping[str, str]) -> Manifest:
    """Return the Secret of an authority; `data` is in base64."""
    return {
        "apiVersion": SECRET.api_version,
        "kind": SECRET.kind,
        "metadata": {
            "name": secret_names(parent.uid)[role],
            "namespace": parent.facts.home,
            "labels": dict(LABELS),
            "annotations": {SERVES: f"{parent.namespace}/{parent.name}", **annotations},
        },
        "type": "kubernetes.io/tls",
        "data": dict(data),
    }
