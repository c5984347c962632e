"""Whose pods may be replaced now: one discovery server after another, a few robots at a time.

A new version of the operator changes what almost every pod reads. Without a limit the whole fleet would fall back to
its robots at once, and both discovery servers of a robot would be gone together, so that starting nodes are not found.
A person's latest change to one RobotOffload is not held back.
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
"""How long robots whose cloud acts wait until the others were first looked at; 2,000 were seen after 76 s."""
AT_ONCE: Final = 10
"""Default number of robots whose pods are replaced at the same time."""
WAITING: Final = "WaitingForTurn"
_ENDED: Final = ("NewReplicaSetAvailable", "ProgressDeadlineExceeded")
"""Reasons of a Deployment's condition Progressing for a complete and for an abandoned rollout."""
_ROLLING: Final = (DEPLOYMENT, STATEFUL_SET)


def rolls(step: Apply, live: Mapping[Key, Manifest]) -> bool:
    """Return whether an apply replaces running pods."""
    key = key_of(step.manifest)
    there = live.get(key)
    if key[0] not in _ROLLING or there is None or not (there.get("spec") or {}).get("replicas", 1):
        return False
    return bool(_read_at_start(step.manifest) != _read_at_start(there))


def in_turn(steps: Plan, live: Mapping[Key, Manifest]) -> Plan:
    """Return the plan with at most one StatefulSet that is not settled: discovery servers stand in for each other.

    A restarted server knows no participants until they announce themselves. Servers that are not ready anyway go first:
    a new version may mend them.
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
    """Return the plan without steps that replace pods."""
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
    """Return what shows a changed pod template: images, arguments, and the hash of what its containers read."""
    template = (manifest.get("spec") or {}).get("template") or {}
    containers = (template.get("spec") or {}).get("containers") or ()
    return (
        ((template.get("metadata") or {}).get("annotations") or {}).get("robotoffload.dev/config-hash"),
        [(one.get("name"), one.get("image"), one.get("args"), one.get("env")) for one in containers],
    )


def under_way(child: Manifest) -> bool:
    """Return whether the pods of a workload are being replaced, according to its own controller.

    This tells a new operator whose turn it was. Pods created for the first time, or after a scaling, replace none; a
    rollout past its deadline (ten minutes unless configured otherwise) makes room for others.
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
    """Return how many pod templates a Deployment has had; 0: its controller has not yet seen it."""
    return int((deployment["metadata"].get("annotations") or {}).get("deployment.kubernetes.io/revision") or 0)


class Budget(Generic[Name]):
    """Limits the robots whose pods are being replaced; robots that act themselves go first.

    Until `resume` is called no robot gets a turn: an earlier operator may have begun with the maximum.

    Args:
        at_once: the limit.
    """

    def __init__(self, at_once: int) -> None:
        self._at_once = at_once
        self._resumed = False
        self._turns: dict[Name, float] = {}
        self._waiting: dict[Name, float] = {}

    def may_roll(self, name: Name, now_s: float, *, cloud_acts: bool) -> bool:
        """Return whether a robot's pods may be replaced now, and if so give it a turn.

        Args:
            name: of the RobotOffload.
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
        """Give turns to the robots whose pods an earlier operator began to replace.

        Args:
            rolling: those robots.
            now_s: the steady clock.
            alone: robots whose cloud does not act, not looked at yet; those whose cloud acts wait for them.
        """
        self._turns |= dict.fromkeys(rolling, now_s)
        self._waiting |= dict.fromkeys(alone, now_s + FIRST_LOOK_S)
        self._resumed = True

    def done(self, name: Name) -> None:
        """Record that all pods of a robot are ready, or that it is gone."""
        self._turns.pop(name, None)
        self._waiting.pop(name, None)
