"""Recordings and policies put together, and the outcomes as plain values for JSON."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from robot_offload.errors import InputError
from robot_offload.replay.costs import Change, Score, Weights, optimum, score
from robot_offload.replay.heartbeats import Heartbeats, derive
from robot_offload.replay.named import NamedPolicy
from robot_offload.replay.play import Progress, play
from robot_offload.traces import Trace
from robot_offload_core.settings import Settings

OPTIMUM = "optimum"
ROUNDING_S = 1e-9
"""Added to the tolerance: recordings often hold whole milliseconds, and exactly the limit is good enough."""


@dataclass(frozen=True)
class Case:
    """A recording and what is asked of it.

    Attributes:
        beats: the heartbeats of the recording.
        settings: of the agent; the periods and the tolerance give the limit of a good link.
        weights: the prices.
    """

    beats: Heartbeats
    settings: Settings
    weights: Weights

    @property
    def limit_us(self) -> int:
        """The longest loop latency that is good enough."""
        return round(self.settings.allowed_loop_s * 1e6)

    @cached_property
    def best(self) -> Outcome:
        """The offline optimum."""
        changes = optimum(self.beats, self.limit_us, self.weights)
        return Outcome(OPTIMUM, changes, self.price(changes))

    def price(self, changes: tuple[Change, ...]) -> Score:
        """What a placement comes to on this recording."""
        return score(changes, self.beats, self.limit_us, self.weights)

    def ratio(self, cost: float) -> float | None:
        """How many times the optimum `cost` is; None when only the optimum costs nothing."""
        least = self.best.score.cost
        if least > 0:
            return cost / least
        return 1.0 if cost == 0 else None


@dataclass(frozen=True)
class Outcome:
    """What a policy did on a recording, and what that came to."""

    policy: str
    changes: tuple[Change, ...]
    score: Score


def case(trace: Trace, settings: Settings, weights: Weights) -> Case:
    """A case from a recording.

    Raises:
        TraceError: the recording is too short.
    """
    forgiving = dataclasses.replace(settings, tolerance_s=settings.tolerance_s + ROUNDING_S)
    return Case(derive(trace, settings.beat_period_s), forgiving, weights)


def outcome(policy: NamedPolicy, subject: Case, progress: Progress | None = None) -> Outcome:
    """Replays `subject` for a fresh `policy`.

    Raises:
        InputError: a policy that is not ours raised something, or answered what is no side.
    """
    try:
        changes = play(policy.make(subject.settings), subject.beats, progress)
    except InputError:
        raise
    except Exception as error:
        if not policy.foreign:
            raise
        raise InputError(f"--policy {policy.name}: {type(error).__name__}: {error}".splitlines()[0]) from error
    return Outcome(policy.name, changes, subject.price(changes))


def plain(subject: Case, outcomes: list[Outcome]) -> dict[str, Any]:
    """One recording as it stands in results.json: figures of each policy, the optimum's among them, and all changes."""
    settings = subject.settings
    return {
        "trace": subject.beats.name,
        "duration_s": subject.beats.duration_us / 1e6,
        "limit_ms": round(settings.allowed_loop_s * 1e3, 3),
        "robot_period_ms": round(settings.robot_period_s * 1e3, 3),
        "cloud_period_ms": round(settings.cloud_period_s * 1e3, 3),
        "tolerance_ms": round(settings.tolerance_s * 1e3, 3),
        "loss_timeout_ms": round(settings.loss_timeout_s * 1e3, 3),
        "weights": dataclasses.asdict(subject.weights),
        "good_pct": round(100 * float(subject.beats.good(subject.limit_us).mean()), 3),
        "policies": [_plain_outcome(subject, each) for each in [*outcomes, subject.best]],
    }


def _plain_outcome(subject: Case, each: Outcome) -> dict[str, Any]:
    figures = {name: round(value, 3) for name, value in dataclasses.asdict(each.score).items()}
    ratio = subject.ratio(each.score.cost)
    changes = [
        {"t_s": change.at_us / 1e6, "site": change.site.value, "reason": change.reason, "message": change.message}
        for change in each.changes
    ]
    return {
        "policy": each.policy,
        **figures,
        "optimum": round(subject.best.score.cost, 3),
        "ratio": None if ratio is None else round(ratio, 4),
        "changes": changes,
    }
