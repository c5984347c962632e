"""Runs policies on recordings and returns the outcomes as plain values for JSON."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from robot_offload.errors import InputError
from robot_offload_core.words.settings import Settings
from robot_offload_lab.links.recorded import Trace
from robot_offload_lab.replay.costs import Change, Score, Weights, optimum, score
from robot_offload_lab.replay.heartbeats import Heartbeats, derive
from robot_offload_lab.replay.limits import adapted_loss_timeout_s, clamped, forbidden
from robot_offload_lab.replay.named import NamedPolicy
from robot_offload_lab.replay.play import Progress, play
from robot_offload_lab.replay.rent_or_buy import RentOrBuy, best_fixed

OPTIMUM = "optimum"
ROUNDING_S = 1e-9
"""Added to the tolerance: recordings often hold whole milliseconds, and a latency of exactly the limit is good."""


@dataclass(frozen=True)
class StudiedLink:
    """A recording and how it is judged.

    Attributes:
        beats: the heartbeats of the recording.
        settings: of the agent; the periods and the tolerance give the limit of a good link.
        weights: the prices.
        limited: whether the hard limits hold: the cloud does not act when nothing has come for the loss timeout.
    """

    beats: Heartbeats
    settings: Settings
    weights: Weights
    limited: bool = True

    @property
    def limit_us(self) -> int:
        """The longest loop latency that is good enough."""
        return round(self.settings.allowed_loop_s * 1e6)

    @property
    def loss_timeout_us(self) -> int:
        """Silence after which no policy may act in the cloud."""
        return round(self.settings.loss_timeout_s * 1e6)

    @cached_property
    def forbidden(self) -> np.typing.NDArray[np.bool_]:
        """Periods in which a hard limit keeps every policy on the robot."""
        if not self.limited:
            return np.zeros(len(self.beats.sent_us), dtype=bool)
        return forbidden(self.beats, self.loss_timeout_us)

    @cached_property
    def unclamped(self) -> StudiedLink:
        """The same without the hard limits."""
        return dataclasses.replace(self, limited=False)

    @cached_property
    def best(self) -> Replayed:
        """The offline optimum."""
        changes = optimum(self.beats, self.limit_us, self.weights, self.forbidden)
        return Replayed(OPTIMUM, changes, self.price(changes))

    @cached_property
    def best_fixed(self) -> RentOrBuy:
        """The best rule of the rent-or-buy grid, in hindsight."""
        return best_fixed(self.beats, self.limit_us, self.weights, self.forbidden)

    def price(self, changes: tuple[Change, ...]) -> Score:
        """Return the price of a placement on this recording, under the hard limits if they hold."""
        if self.limited:
            changes = clamped(changes, self.beats, self.loss_timeout_us)
        return score(changes, self.beats, self.limit_us, self.weights)

    def ratio(self, cost: float) -> float | None:
        """Return `cost` as a multiple of the optimum; None when only the optimum costs nothing."""
        return _ratio(cost, self.best.score.cost)

    def ratio_best_fixed(self, cost: float) -> float | None:
        """Return `cost` as a multiple of the best fixed rule's; None when only that rule costs nothing."""
        return _ratio(cost, self.best_fixed.cost)


@dataclass(frozen=True)
class Replayed:
    """What a policy did on a recording, and its price.

    Attributes:
        policy: its name.
        changes: of side, under the hard limits.
        score: the price of these.
        wishes: changes that the policy alone wanted; None when they are the same.
    """

    policy: str
    changes: tuple[Change, ...]
    score: Score
    wishes: tuple[Change, ...] | None = None


def case(trace: Trace, settings: Settings, weights: Weights, *, adapt: bool = True) -> StudiedLink:
    """Return a case from a recording.

    Args:
        trace: the recording.
        settings: of the agent.
        weights: the prices.
        adapt: whether the loss timeout follows the recording (limits.adapted_loss_timeout_s), not `settings`.

    Raises:
        TraceError: the recording is too short.
    """
    forgiving = dataclasses.replace(settings, tolerance_s=settings.tolerance_s + ROUNDING_S)
    if adapt:
        forgiving = dataclasses.replace(forgiving, loss_timeout_s=adapted_loss_timeout_s(trace))
    return StudiedLink(derive(trace, settings.beat_period_s), forgiving, weights)


def outcome(policy: NamedPolicy, subject: StudiedLink, progress: Progress | None = None) -> Replayed:
    """Replay `subject` for a fresh `policy`.

    Raises:
        InputError: a user's own policy raised an exception, or its answer is not a side.
    """
    try:
        wishes = play(policy.make(subject.settings), subject.beats, progress)
    except InputError:
        raise
    except Exception as error:
        if not policy.foreign:
            raise
        raise InputError(f"--policy {policy.name}: {type(error).__name__}: {error}".splitlines()[0]) from error
    changes = clamped(wishes, subject.beats, subject.loss_timeout_us) if subject.limited else wishes
    return Replayed(policy.name, changes, subject.price(wishes), None if wishes == changes else wishes)


def plain(subject: StudiedLink, outcomes: list[Replayed]) -> dict[str, Any]:
    """Return a recording as in results.json: the figures of each policy and of the optimum, and all changes."""
    settings, rule = subject.settings, subject.best_fixed
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
        "best_fixed_rule": {"silence_s": rule.silence_s, "out": _or_never(rule.out), "back": _or_never(rule.back)},
        "policies": [_plain_outcome(subject, each) for each in [*outcomes, subject.best]],
    }


def figures(subject: StudiedLink, found: Score) -> dict[str, Any]:
    """Return the figures of a placement beside the yardsticks of its recording."""
    rounded = {name: round(value, 3) for name, value in dataclasses.asdict(found).items()}
    ratio, ratio_best_fixed = subject.ratio(found.cost), subject.ratio_best_fixed(found.cost)
    return {
        **rounded,
        "J": rounded["cost"],
        "optimum": round(subject.best.score.cost, 3),
        "ratio": None if ratio is None else round(ratio, 4),
        "best_fixed": round(subject.best_fixed.cost, 3),
        "ratio_best_fixed": None if ratio_best_fixed is None else round(ratio_best_fixed, 4),
    }


def _plain_outcome(subject: StudiedLink, each: Replayed) -> dict[str, Any]:
    free = subject.unclamped
    unclamped = free.best if each is subject.best else None
    wishes = each.changes if each.wishes is None else each.wishes
    changes = [
        {"t_s": change.at_us / 1e6, "site": change.site.value, "reason": change.reason, "message": change.message}
        for change in each.changes
    ]
    return {
        "policy": each.policy,
        **figures(subject, each.score),
        "unclamped": figures(free, unclamped.score if unclamped else free.price(wishes)),
        "changes": changes,
    }


def _ratio(cost: float, least: float) -> float | None:
    if least > 0:
        return cost / least
    return 1.0 if cost == 0 else None


def _or_never(regret: float) -> float | str:
    return "never" if math.isinf(regret) else regret
