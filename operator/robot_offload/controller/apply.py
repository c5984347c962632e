"""Writes what a plan says, in its order, and goes on after a refusal that concerns one object only."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from robot_offload.decide.decision import Verdict, no, yes
from robot_offload.decide.drift import Settled, settle
from robot_offload.decide.ownership import Key, key_of
from robot_offload.decide.plan import Obstacle, Plan
from robot_offload.kube.errors import (
    ForbiddenError,
    KubeError,
    NotFoundError,
    TooManyError,
    UnauthorizedError,
    UnreachableError,
)
from robot_offload.kube.kinds import CERTIFICATE, kind_of
from robot_offload.kube.port import KubeApi, Manifest

_NO_USE_TO_GO_ON = (UnreachableError, TooManyError, UnauthorizedError)


@dataclass(slots=True)
class Done:
    """What became of one or more plans.

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
    def failed(self) -> bool:
        """Whether it must be tried again without any event."""
        return bool(self.errors)


async def carry_out(
    api: KubeApi, plan: Plan, live: dict[Key, Manifest], settled: dict[Key, Settled], done: Done
) -> None:
    """Carries out a plan; `live`, `settled` and `done` are brought up to date."""
    done.obstacles += plan.obstacles
    for step in plan.applies:
        if done.stopped:
            return
        try:
            answer = await api.apply(step.manifest, force=step.force)
        except KubeError as error:
            _note(error, step.manifest, done)
            continue
        done.writes += 1
        key = key_of(step.manifest)
        live[key] = answer
        step.manifest["metadata"].pop("uid", None)
        kept = settle(step.manifest, answer)
        if kept is None:
            settled.pop(key, None)
        else:
            settled[key] = kept
    for child in plan.deletes:
        if done.stopped:
            return
        metadata = child["metadata"]
        try:
            await api.delete(kind_of(child), metadata.get("namespace"), metadata["name"], metadata["uid"])
        except KubeError as error:
            _note(error, child, done)
            continue
        done.writes += 1
        live.pop(key_of(child), None)
        settled.pop(key_of(child), None)


def applied(done: Done) -> Verdict:
    """Whether all children are as declared, for the condition ResourcesApplied."""
    messages = [obstacle.message for obstacle in done.obstacles] + [str(error) for error in done.errors]
    if done.obstacles:
        lasting: Sequence[Obstacle] = [obstacle for obstacle in done.obstacles if not obstacle.passing]
        return no((lasting or done.obstacles)[0].reason, "; ".join(messages))
    if done.errors:
        return no(done.errors[0].reason, "; ".join(messages))
    return yes("Applied", "All objects in the cluster are as declared")


def _note(error: KubeError, manifest: Manifest, done: Done) -> None:
    if kind_of(manifest) == CERTIFICATE and isinstance(error, NotFoundError | ForbiddenError):
        help_text = (
            "install cert-manager or remove spec.transport.certificates.issuerRef"
            if isinstance(error, NotFoundError)
            else "give the operator its rights: helm upgrade --set certManager.enabled=true"
        )
        error = type(error)(f"{error}; {help_text}", status=error.status)
    done.errors.append(error)
    done.stopped = isinstance(error, _NO_USE_TO_GO_ON)
