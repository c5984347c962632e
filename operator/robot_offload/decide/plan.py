"""From wanted and live objects to the remaining writes: apply, delete, or the reason why not."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from robot_offload.decide.additions import additions
from robot_offload.decide.contests import Contest, contested, other_manager
from robot_offload.decide.drift import Settled, digest, in_place, settle, stamped
from robot_offload.decide.ownership import (
    Key,
    being_deleted,
    belongs,
    controller_of,
    described,
    key_of,
    owner_described,
)
from robot_offload.decide.scaling import followed
from robot_offload.kube.port import Manifest


@dataclass(frozen=True, slots=True)
class Apply:
    """One server-side apply.

    Attributes:
        manifest: what to apply, stamped.
        force: whether to take back fields that others changed: only on objects that are already ours.
        uid: a precondition: only the object that was read is written to; empty: it did not exist.
        rival: who changed it since exactly this was applied; empty: nobody, the manifest is new.
    """

    manifest: Manifest
    force: bool
    uid: str = ""
    rival: str = ""

    @property
    def body(self) -> Manifest:
        """Return what to send: the manifest with its precondition."""
        if not self.uid:
            return self.manifest
        return {**self.manifest, "metadata": {**self.manifest["metadata"], "uid": self.uid}}


@dataclass(frozen=True, slots=True)
class Obstacle:
    """A child that cannot be applied now.

    Attributes:
        reason: one CamelCase word.
        message: whose the name is, and what to do.
        passing: whether it resolves itself.
        recheck_s: seconds after which to retry without an event; None: an event will follow.
        key: the object that is in the way; None: there is none.
    """

    reason: str
    message: str
    passing: bool
    recheck_s: float | None = None
    key: Key | None = None


@dataclass(frozen=True, slots=True)
class Plan:
    """All writes of one pass, in order.

    Attributes:
        applies: children to create or to correct.
        deletes: children that are no longer wanted, as they are live.
        obstacles: children that cannot be applied.
        additions: what others added to children, in words.
    """

    applies: tuple[Apply, ...] = ()
    deletes: tuple[Manifest, ...] = ()
    obstacles: tuple[Obstacle, ...] = ()
    additions: tuple[str, ...] = ()

    @property
    def touched(self) -> tuple[Key, ...]:
        """Return the children that the plan would write."""
        return (*(key_of(step.manifest) for step in self.applies), *map(key_of, self.deletes))

    @property
    def doubtful(self) -> tuple[Key, ...]:
        """Return the objects to read once more before the plan counts: what it would write, and what is in the way."""
        return (*self.touched, *(one.key for one in self.obstacles if one.key is not None))


@dataclass(frozen=True, slots=True)
class History:
    """What earlier passes learnt about the children; losing it costs requests, never correctness.

    Attributes:
        settled: the API server's form of earlier manifests.
        applied: the digest last applied, by child.
        contests: children that another controller keeps changing.
    """

    settled: dict[Key, Settled] = field(default_factory=dict)
    applied: dict[Key, str] = field(default_factory=dict)
    contests: dict[Key, Contest] = field(default_factory=dict)

    def remember(self, step: Apply, answer: Manifest, now_s: float) -> None:
        """Record the result of an apply."""
        key = key_of(step.manifest)
        if step.rival:
            self.contests[key] = self.contests.get(key, Contest()).taken_back(now_s, step.rival)
        self.applied[key] = digest(step.manifest)
        kept = settle(step.manifest, answer)
        if kept is None:
            self.settled.pop(key, None)
        else:
            self.settled[key] = kept

    def forget(self, key: Key) -> None:
        """Drop what is known about a deleted child."""
        for part in (self.settled, self.applied, self.contests):
            part.pop(key, None)


def plan(
    wanted: Iterable[Manifest],
    live: Mapping[Key, Manifest],
    uid: str,
    *,
    prunable: Iterable[Key] = (),
    history: History | None = None,
    now_s: float = 0.0,
) -> Plan:
    """Compare wanted with live.

    Args:
        wanted: the children, in the order in which to apply them.
        live: all objects with the children's labels, and any other object with the name of a wanted child.
        uid: of the RobotOffload.
        prunable: the only children that may be deleted, if they are ours and not among `wanted`.
        history: what earlier passes learnt.
        now_s: our steady clock.
    """
    known = history or History()
    applies: list[Apply] = []
    obstacles: list[Obstacle] = []
    names: set[Key] = set()
    added: list[str] = []
    for manifest in wanted:
        key = key_of(manifest)
        names.add(key)
        stamp = stamped(manifest, uid)
        there = live.get(key)
        if there is not None:
            stamp = followed(stamp, there)
        if there is not None and belongs(there, uid):
            added.append(additions(manifest, there))
        if there is None:
            applies.append(Apply(stamp, force=False))
        elif being_deleted(there):
            obstacles.append(_leaving(there))
        elif not belongs(there, uid):
            obstacles.append(_taken(there, manifest))
        elif not in_place(stamp, there, known.settled.get(key)):
            again = known.applied.get(key) == digest(stamp)
            contest = known.contests.get(key, Contest())
            if again and contest.waits_s(now_s) > 0:
                obstacles.append(_fought_over(there, contest, now_s))
            else:
                rival = other_manager(there) if again else ""
                applies.append(Apply(stamp, force=True, uid=there["metadata"]["uid"], rival=rival))
    doomed = [live[key] for key in prunable if key in live and key not in names]
    deletes = [child for child in doomed if belongs(child, uid) and not being_deleted(child)]
    return Plan(tuple(applies), tuple(deletes), tuple(obstacles), tuple(filter(None, added)))


def _fought_over(there: Manifest, contest: Contest, now_s: float) -> Obstacle:
    verdict = contested(there, contest)
    return Obstacle(verdict.reason, verdict.message, False, contest.waits_s(now_s), key_of(there))


def _leaving(there: Manifest) -> Obstacle:
    return Obstacle(
        "WaitingForDeletion",
        f"{described(there)} is being deleted; it is made again when it is gone",
        True,
        key=key_of(there),
    )


def _taken(there: Manifest, wanted: Manifest) -> Obstacle:
    ours, theirs = controller_of(wanted) or {}, controller_of(there) or {}
    if theirs.get("kind") == ours.get("kind") and theirs.get("name") == ours.get("name"):
        return Obstacle(
            "WaitingForDeletion",
            f"{described(there)} belongs to an earlier {ours.get('kind')} of this name; it is made again when it is "
            "gone",
            True,
            key=key_of(there),
        )
    return Obstacle(
        "NameTaken",
        f"{described(there)} exists and {owner_described(there)}; it is left alone. Delete or rename it, or give this "
        f"{ours.get('kind', 'object')} another name",
        False,
        key=key_of(there),
    )
