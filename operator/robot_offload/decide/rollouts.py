"""Whose pods may be replaced now: discovery servers one after the other, robots a few at a time.

A new version of the operator changes what almost every pod reads. Without a limit the whole fleet would fall back to
its robots at once, and both discovery servers of a robot would be gone together: nodes that start then are not found.
What a person has just changed in one RobotOffload is not held back.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping
from dataclasses import replace
from typing import Any, Final, Generic, TypeVar

from robot_offload.decide.ownership import Key, described, key_of
from robot_offload.decide.plan import Apply, Obstacle, Plan
from robot_offload.decide.workloads import settled, workload
from robot_offload.kube.kinds import DEPLOYMENT, STATEFUL_SET
from robot_offload.kube.port import Manifest

Name = TypeVar("Name", bound=Hashable)

GIVE_UP_S: Final = 600.0
"""After this long a robot whose pods do not become ready makes room for others."""
LOOK_AGAIN_S: Final = 5.0
FIRST_LOOK_S: Final = 60.0
"""For so long robots whose cloud acts wait for a first look at the others; 2,000 were seen after 76 s."""
AT_ONCE: Final = 10
"""Robots whose pods are replaced at the same time, unless the operator is told another number."""
WAITING: Final = "WaitingForTurn"
_ENDED: Final = ("NewReplicaSetAvailable", "ProgressDeadlineExceeded")
"""What a Deployment's condition Progressing says of a rollout that is complete, and of one that is given up."""
_ROLLING: Final = (DEPLOYMENT, STATEFUL_SET)


def rolls(step: Apply, live: Mapping[Key, Manifest]) -> bool:
    """Return whether an apply replaces pods that run."""
    key = key_of(step.manifest)
    there = live.get(key)
    if key[0] not in _ROLLING or there is None or not (there.get("spec") or {}).get("replicas", 1):
        return False
    return bool(_read_at_start(step.manifest) != _read_at_start(there))


def in_turn(steps: Plan, live: Mapping[Key, Manifest]) -> Plan:
    """Return the plan with one StatefulSet at most that is not settled: discovery servers stand in for each other.

    A server that has just returned knows nobody until the participants have told it. Those that are not ready anyway go
    first: a new version may be what mends them.
    """
    rolling = [step for step in steps.applies if key_of(step.manifest)[0] == STATEFUL_SET and rolls(step, live)]
    servers = {key: child for key, child in live.items() if key[0] == STATEFUL_SET}
    down = {key for key, child in servers.items() if not workload(child).holds}
    new = {key for key, child in servers.items() if not settled(child)}
    mending = [step for step in rolling if key_of(step.manifest) in down]
    allowed = mending or ([] if new else rolling[:1])
    held = [step for step in rolling if step not in allowed]
    return _without(steps, held, "it is replaced when the other discovery servers have been ready for some seconds")


def held_back(steps: Plan, live: Mapping[Key, Manifest]) -> Plan:
    """Return the plan without anything that replaces pods."""
    held = [step for step in steps.applies if rolls(step, live)]
    return _without(steps, held, "its pods are replaced when other robots are done")


def _without(steps: Plan, held: Iterable[Apply], why: str) -> Plan:
    left_out = list(held)
    obstacles = [
        Obstacle("WaitingForTurn", f"{described(step.manifest)}: {why}", True, LOOK_AGAIN_S) for step in left_out
    ]
    applies = tuple(step for step in steps.applies if step not in left_out)
    return replace(steps, applies=applies, obstacles=(*steps.obstacles, *obstacles))


def _read_at_start(manifest: Manifest) -> Any:
    """Return what a changed pod template shows in: images, arguments, and the hash of what its containers read."""
    template = (manifest.get("spec") or {}).get("template") or {}
    containers = (template.get("spec") or {}).get("containers") or ()
    return (
        ((template.get("metadata") or {}).get("annotations") or {}).get("robotoffload.dev/config-hash"),
        [(one.get("name"), one.get("image"), one.get("args"), one.get("env")) for one in containers],
    )


def under_way(child: Manifest) -> bool:
    """Return whether the pods of a workload are being replaced, by what its own controller says of it.

    So a new operator knows whose turn it was. Pods that are made for the first time, or return after a scaling, replace
    none; a rollout past its deadline (ten minutes unless the cluster says otherwise) makes room for others.
    """
    status = child.get("status") or {}
    if not (child.get("spec") or {}).get("replicas", 1) or workload(child).holds:
        return False
    if key_of(child)[0] == STATEFUL_SET:
        return bool(status.get("currentRevision") != status.get("updateRevision"))
    if key_of(child)[0] != DEPLOYMENT:
        return False
    if int(status.get("observedGeneration") or 0) < int(child["metadata"].get("generation") or 0):
        return bool(_revision(child) > 0)
    progress: Manifest = next((one for one in status.get("conditions") or () if one.get("type") == "Progressing"), {})
    return _revision(child) > 1 and progress.get("reason") not in _ENDED


def _revision(deployment: Manifest) -> int:
    """Return how many pod templates a Deployment has had; 0: its controller has not seen it."""
    return int((deployment["metadata"].get("annotations") or {}).get("deployment.kubernetes.io/revision") or 0)


class Budget(Generic[Name]):
    """At most so many robots whose pods are being replaced; robots that act themselves go first.

    Until `resume` was called nobody gets a turn: an earlier operator may have begun with as many as are allowed.

    Args:
        at_once: how many.
    """

    def __init__(self, at_once: int) -> None:
        self._at_once = at_once
        self._resumed = False
        self._turns: dict[Name, float] = {}
        self._waiting: dict[Name, float] = {}

    def may_roll(self, name: Name, now_s: float, *, cloud_acts: bool) -> bool:
        """Return whether a robot's pods may be replaced now, and take its turn if so.

        Args:
            name: which one.
            now_s: the steady clock.
            cloud_acts: whether its cloud acts: such a robot waits for those that lose nothing.
        """
        self._turns = {one: began_s for one, began_s in self._turns.items() if now_s - began_s < GIVE_UP_S}
        self._waiting = {one: since for one, since in self._waiting.items() if now_s - since < 3 * LOOK_AGAIN_S}
        if name in self._turns:
            return True
        if not self._resumed:
            return False
        if not cloud_acts:
            self._waiting[name] = now_s
        others = self._waiting.keys() - {name}
        if len(self._turns) >= self._at_once or (cloud_acts and others):
            return False
        self._waiting.pop(name, None)
        self._turns[name] = now_s
        return True

    def resume(self, rolling: Iterable[Name], now_s: float, alone: Iterable[Name] = ()) -> None:
        """Give turns to those whose pods an earlier operator has begun to replace.

        Args:
            rolling: those robots.
            now_s: the steady clock.
            alone: robots whose cloud does not act. Nobody has looked at them yet; those whose cloud acts wait for that.
        """
        self._turns |= dict.fromkeys(rolling, now_s)
        self._waiting |= dict.fromkeys(alone, now_s + FIRST_LOOK_S)
        self._resumed = True

    def done(self, name: Name) -> None:
        """Note that all pods of a robot are ready, or that it is gone."""
        self._turns.pop(name, None)
        self._waiting.pop(name, None)
