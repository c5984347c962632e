"""Writes what a plan says, in its order, and goes on after a refusal that concerns one object only."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

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
from robot_offload.kube.kinds import CERTIFICATE, SECRET, kind_of
from robot_offload.kube.port import KubeApi, Manifest

_NO_USE_TO_GO_ON = (UnreachableError, TooManyError, UnauthorizedError)


@dataclass(slots=True)
class Applied:
    """What became of one plan, or of all plans of a pass.

    Attributes:
        errors: refusals, in order.
        obstacles: children that could not be tried.
        stopped: whether the rest was left out, because the API server is in trouble.
        writes: how many writes succeeded.
    """

    errors: list[KubeError] = field(default_factory=list)
    obstacles: list[Obstacle] = field(default_factory=list)
    stopped: bool = False
    writes: int = 0

    @property
    def complete(self) -> bool:
        """Returns whether everything is as the plan wants it."""
        return not (self.errors or self.obstacles or self.stopped)

    @property
    def recheck_s(self) -> float | None:
        """Returns the seconds after which a new attempt may succeed though nothing happens; None: an event tells."""
        return min((one.recheck_s for one in self.obstacles if one.recheck_s is not None), default=None)

    @property
    def verdict(self) -> Verdict:
        """Returns whether all children are as declared, for the condition ResourcesApplied."""
        if self.obstacles and not self.errors and all(one.reason == WAITING for one in self.obstacles):
            # What runs is complete and in order; only its next version is not there yet.
            return yes("WaitingForTurn", "; ".join(one.message for one in self.obstacles))
        messages = [obstacle.message for obstacle in self.obstacles] + [str(error) for error in self.errors]
        if self.obstacles:
            lasting: Sequence[Obstacle] = [obstacle for obstacle in self.obstacles if not obstacle.passing]
            return no((lasting or self.obstacles)[0].reason, "; ".join(messages))
        if self.errors:
            return no(self.errors[0].reason, "; ".join(messages))
        return yes("Applied", "All objects in the cluster are as declared")

    def add(self, other: Applied) -> None:
        """Takes in what became of a further plan."""
        self.errors += other.errors
        self.obstacles += other.obstacles
        self.stopped = self.stopped or other.stopped
        self.writes += other.writes


async def carry_out(
    api: KubeApi, store: Store, plan: Plan, live: dict[Key, Manifest], history: History, clock: Clock
) -> Applied:
    """Carries out a plan; brings `store`, `live` and `history` up to date."""
    done = Applied(obstacles=list(plan.obstacles))
    for step in plan.applies:
        if done.stopped:
            return done
        try:
            answer = await _write(api, step)
        except KubeError as error:
            _note(error, step.manifest, done)
            continue
        done.writes += 1
        key = key_of(step.manifest)
        live[key] = answer
        store.put(key[0], answer)
        history.remember(step, answer, clock.steady_s())
    for child in plan.deletes:
        if done.stopped:
            return done
        metadata = child["metadata"]
        try:
            await api.delete(kind_of(child), metadata.get("namespace"), metadata["name"], metadata["uid"])
        except KubeError as error:
            _note(error, child, done)
            continue
        done.writes += 1
        live.pop(key_of(child), None)
        history.forget(key_of(child))
    return done


async def _write(api: KubeApi, step: Apply) -> Manifest:
    """Applies a child.

    A Secret that is not there is created instead: a write of a leader that has lost its Lease may arrive late, and an
    apply would then put its authority in place of the one that robots were given meanwhile.
    """
    if not step.uid and kind_of(step.manifest) == SECRET:
        return await api.create(step.manifest)
    return await api.apply(step.body, force=step.force)


def _note(error: KubeError, manifest: Manifest, done: Applied) -> None:
    if kind_of(manifest) == CERTIFICATE and isinstance(error, NotFoundError | ForbiddenError):
        help_text = (
            "install cert-manager or remove spec.transport.certificates.issuerRef"
            if isinstance(error, NotFoundError)
            else "give the operator its rights: helm upgrade --set certManager.enabled=true"
        )
        error = type(error)(f"{error}; {help_text}", status=error.status)
    done.errors.append(error)
    done.stopped = isinstance(error, _NO_USE_TO_GO_ON)
