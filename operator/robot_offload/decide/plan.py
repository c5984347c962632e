"""From wanted and live objects to the writes that are left: apply, delete, or say why not."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from robot_offload.decide.drift import Settled, in_place, stamped
from robot_offload.decide.ownership import Key, being_deleted, belongs, controller_of, key_of, owner_told, told
from robot_offload.kube.port import Manifest


@dataclass(frozen=True, slots=True)
class Apply:
    """One server-side apply.

    Attributes:
        manifest: what to apply, stamped.
        force: whether fields that others changed are taken back: only on objects that are ours already.
    """

    manifest: Manifest
    force: bool


@dataclass(frozen=True, slots=True)
class Obstacle:
    """A child that cannot be made now.

    Attributes:
        reason: one CamelCase word.
        message: whose the name is, and what to do.
        passing: whether it goes away by itself.
    """

    reason: str
    message: str
    passing: bool


@dataclass(frozen=True, slots=True)
class Plan:
    """All writes of one pass, in order.

    Attributes:
        applies: children to make or to put right.
        deletes: children that are no longer wanted, as they are live.
        obstacles: children that cannot be made.
    """

    applies: tuple[Apply, ...] = ()
    deletes: tuple[Manifest, ...] = ()
    obstacles: tuple[Obstacle, ...] = ()

    @property
    def empty(self) -> bool:
        """Whether there is nothing to write."""
        return not (self.applies or self.deletes)


def plan(
    wanted: Iterable[Manifest],
    live: Mapping[Key, Manifest],
    uid: str,
    settled: Mapping[Key, Settled] | None = None,
    kept: Iterable[Key] = (),
) -> Plan:
    """Compares wanted with live.

    Args:
        wanted: the children, in the order in which they are to be applied.
        live: all objects of the children's labels, and any other object that has the name of a wanted child.
        uid: of the RobotOffload.
        settled: what the API server made of earlier manifests.
        kept: objects that are neither wanted nor pruned (somebody else writes them).
    """
    applies: list[Apply] = []
    obstacles: list[Obstacle] = []
    names: set[Key] = set(kept)
    for manifest in wanted:
        key = key_of(manifest)
        names.add(key)
        stamp = stamped(manifest, uid)
        there = live.get(key)
        if there is None:
            applies.append(Apply(stamp, force=False))
        elif being_deleted(there):
            obstacles.append(_leaving(there))
        elif not belongs(there, uid):
            obstacles.append(_taken(there, manifest))
        elif not in_place(stamp, there, (settled or {}).get(key)):
            # The uid is a precondition: what we looked at is what we write to, or nothing is written.
            stamp["metadata"]["uid"] = there["metadata"]["uid"]
            applies.append(Apply(stamp, force=True))
    deletes = [
        child for key, child in live.items() if key not in names and belongs(child, uid) and not being_deleted(child)
    ]
    return Plan(tuple(applies), tuple(deletes), tuple(obstacles))


def _leaving(there: Manifest) -> Obstacle:
    return Obstacle("WaitingForDeletion", f"{told(there)} is being deleted; it is made again when it is gone", True)


def _taken(there: Manifest, wanted: Manifest) -> Obstacle:
    ours, theirs = controller_of(wanted) or {}, controller_of(there) or {}
    if theirs.get("kind") == ours.get("kind") and theirs.get("name") == ours.get("name"):
        return Obstacle(
            "WaitingForDeletion",
            f"{told(there)} belongs to an earlier {ours.get('kind')} of this name; it is made again when it is gone",
            True,
        )
    return Obstacle(
        "NameTaken",
        f"{told(there)} exists and {owner_told(there)}; it is left alone. Delete or rename it, or give this "
        f"{ours.get('kind', 'object')} another name",
        False,
    )
