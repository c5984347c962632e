"""Carries out a plan in its order; a refusal that concerns only one object does not end it."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass, field
from typing import Final, TypeVar

from robot_offload.controller.clock import Clock
from robot_offload.controller.store import Store
from robot_offload.decide.ownership import Key, key_of
from robot_offload.decide.plan import Apply, History, Obstacle, Plan
from robot_offload.decide.rollouts import WAITING
from robot_offload.decide.verdicts import Verdict, no, yes
from robot_offload.kube.errors import (
    ForbiddenError,
    KubeError,
    NotFoundError,
    TooManyError,
    UnauthorizedError,
    UnreachableError,
)
from robot_offload.kube.kinds import CERTIFICATE, DEPLOYMENT, JOB, ROLE_BINDING, SECRET, STATEFUL_SET, kind_of
from robot_offload.kube.port import KubeApi, Manifest

AT_ONCE: Final = 8
"""Concurrent writes of one pass."""
_NO_USE_TO_GO_ON: Final = (UnreachableError, TooManyError, UnauthorizedError)
_WAVES: Final = ((ROLE_BINDING,), (DEPLOYMENT, STATEFUL_SET, JOB))
"""Kinds that are written after everything before them. The API server looks up the Role of a RoleBinding. Owners of
pods are written last: policies, rights and files exist when the pods start."""
ADDED: Final = "All fields of ours are as declared, and others have added to the objects"
_Step = TypeVar("_Step")


@dataclass(slots=True)
class Applied:
    """The result of one plan, or of all plans of a pass.

    Attributes:
        errors: refusals, in order.
        obstacles: children that could not be tried.
        stopped: whether the rest was left out because the API server is in trouble.
        writes: how many writes succeeded.
        additions: what others added to children, in words.
    """

    errors: list[KubeError] = field(default_factory=list)
    obstacles: list[Obstacle] = field(default_factory=list)
    stopped: bool = False
    writes: int = 0
    additions: list[str] = field(default_factory=list)

    @property
    def complete(self) -> bool:
        """Return whether everything is as the plan wants it."""
        return not (self.errors or self.obstacles or self.stopped)

    @property
    def recheck_s(self) -> float | None:
        """Return the seconds after which a new attempt may succeed without an event; None: an event will come."""
        return min((one.recheck_s for one in self.obstacles if one.recheck_s is not None), default=None)

    @property
    def verdict(self) -> Verdict:
        """Return whether all children are as declared (condition ResourcesApplied)."""
        if self.obstacles and not self.errors and all(one.reason == WAITING for one in self.obstacles):
            # What runs is complete and in order; only its next version is still missing.
            return yes("WaitingForTurn", "; ".join(one.message for one in self.obstacles))
        messages = [obstacle.message for obstacle in self.obstacles] + [str(error) for error in self.errors]
        if self.obstacles:
            lasting: Sequence[Obstacle] = [obstacle for obstacle in self.obstacles if not obstacle.passing]
            return no((lasting or self.obstacles)[0].reason, "; ".join(messages))
        if self.errors:
            return no(self.errors[0].reason, "; ".join(messages))
        if self.additions:
            return yes("AppliedWithAdditions", f"{ADDED}: {'; '.join(self.additions)}")
        return yes("Applied", "All objects in the cluster are as declared")

    def add(self, other: Applied) -> None:
        """Add the result of a further plan."""
        self.errors += other.errors
        self.obstacles += other.obstacles
        self.stopped = self.stopped or other.stopped
        self.writes += other.writes
        self.additions += other.additions


async def carry_out(
    api: KubeApi, store: Store, plan: Plan, live: dict[Key, Manifest], history: History, clock: Clock
) -> Applied:
    """Carry out a plan; bring `store`, `live` and `history` up to date.

    Kinds on one line of the plan's order are written at once: an object waits for one answer instead of twenty.
    """
    done = Applied(obstacles=list(plan.obstacles), additions=list(plan.additions))

    async def apply(step: Apply) -> None:
        answer = await _write(api, step)
        key = key_of(step.manifest)
        live[key] = answer
        store.put(key[0], answer)
        history.remember(step, answer, clock.steady_s())

    async def delete(child: Manifest) -> None:
        metadata = child["metadata"]
        await api.delete(kind_of(child), metadata.get("namespace"), metadata["name"], metadata["uid"])
        live.pop(key_of(child), None)
        history.forget(key_of(child))

    for steps in _in_waves(plan.applies):
        await _all(apply, steps, lambda step: step.manifest, done)
    await _all(delete, plan.deletes, lambda child: child, done)
    return done


def _in_waves(steps: Sequence[Apply]) -> list[list[Apply]]:
    """Group the steps so that each group needs only those before it to be written."""
    waves: list[list[Apply]] = [[] for _ in range(len(_WAVES) + 1)]
    for step in steps:
        kind = kind_of(step.manifest)
        waves[next((index for index, kinds in enumerate(_WAVES, 1) if kind in kinds), 0)].append(step)
    return waves


async def _all(
    write: Callable[[_Step], Awaitable[None]],
    steps: Sequence[_Step],
    about: Callable[[_Step], Manifest],
    done: Applied,
) -> None:
    """Make independent writes; record their errors in the order of the steps."""
    may = asyncio.Semaphore(AT_ONCE)

    async def one(step: _Step) -> None:
        async with may:
            if done.stopped:
                return
            try:
                await write(step)
            except _NO_USE_TO_GO_ON:
                done.stopped = True
                raise
            done.writes += 1

    for step, result in zip(steps, await asyncio.gather(*map(one, steps), return_exceptions=True), strict=True):
        if isinstance(result, KubeError):
            done.errors.append(_explained(result, about(step)))
        elif result is not None:
            raise result


async def _write(api: KubeApi, step: Apply) -> Manifest:
    """Apply a child.

    A missing Secret is created instead: a late write of a leader that has lost its Lease could otherwise replace the
    authority that robots were given meanwhile.
    """
    if not step.uid and kind_of(step.manifest) == SECRET:
        return await api.create(step.manifest)
    return await api.apply(step.body, force=step.force)


def _explained(error: KubeError, manifest: Manifest) -> KubeError:
    """Return an error with its remedy, if that depends on the object."""
    if kind_of(manifest) != CERTIFICATE or not isinstance(error, NotFoundError | ForbiddenError):
        return error
    help_text = (
        "install cert-manager or remove spec.transport.certificates.issuerRef"
        if isinstance(error, NotFoundError)
        else "give the operator its rights: helm upgrade --set certManager.enabled=true"
    )
    return type(error)(f"{error}; {help_text}", status=error.status)
