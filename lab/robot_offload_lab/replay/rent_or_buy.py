"""The yardstick: what the best rule of "rent or buy" costs on a recording, its parameters chosen in hindsight.

A causal signal is bad when the newest heartbeat's latency is above the bound or nothing has come for S. Regret grows by
the price of a second exposed while in the cloud under a bad signal, and by the price of a second wasted while on the
robot under a good one. Otherwise it falls at the same rate, never below 0. The rule moves when regret reaches the price
of a switch times `out` (leaving the cloud) or times `back` (returning); then regret starts from 0.

A heartbeat period under a signal counts from its beginning, so that the quickest rules move with the first bad signal:
the yardstick is too good rather than too bad.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robot_offload_lab.replay.costs import Weights
from robot_offload_lab.replay.heartbeats import Heartbeats
from robot_offload_lab.replay.limits import newest

SILENCES_S: Final = (0.060, 0.100, 0.150)
OUTS: Final = (0.4, 0.8, 1.5, 3.0, 6.0, 20.0, np.inf)
BACKS: Final = (0.2, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, np.inf)
PAIRS: Final = tuple(itertools.product(OUTS, BACKS))
ROUNDING: Final = 1e-9

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class RentOrBuy:
    """One rule of the grid and what it costs.

    Attributes:
        silence_s: S, seconds without any heartbeat that mean a bad link.
        out, back: regret at which it moves, in switches; infinity for never.
        cost: J.
    """

    silence_s: float
    out: float
    back: float
    cost: float


def best_fixed(beats: Heartbeats, limit_us: int, weights: Weights, forbidden: NDArray[np.bool_]) -> RentOrBuy:
    """Return the cheapest rule of the grid on this recording.

    Args:
        beats: of the recording.
        limit_us: the bound, the longest loop latency that is good enough.
        weights: the prices.
        forbidden: periods in which a hard limit keeps everybody on the robot.
    """
    rules = grid(beats, limit_us, weights, forbidden)
    return min(rules, key=lambda rule: rule.cost)


def grid(
    beats: Heartbeats, limit_us: int, weights: Weights, forbidden: NDArray[np.bool_], *,
    silences_s: Sequence[float] = SILENCES_S, pairs: Sequence[tuple[float, float]] = PAIRS, share: float = 1.0,
    memory: tuple[float, float] | None = None,
) -> list[RentOrBuy]:  # fmt: skip
    """Return every rule of the grid with its cost.

    Args:
        beats: of the recording.
        limit_us: the bound, the longest loop latency that is good enough.
        weights: the prices.
        forbidden: periods in which a hard limit keeps everybody on the robot.
        silences_s: the values of S that span the grid.
        pairs: its values of (out, back).
        share: of the bound, over which a latency is bad.
        memory: (window in seconds, share): no rule returns while more than this share of the window's beats were truly
            bad, which is known one bound later.
    """
    seen, truth = newest(beats), beats.good(limit_us)
    found = []
    held = np.zeros(len(truth), dtype=bool) if memory is None else _held(truth, beats.period_us, limit_us, *memory)
    for silence_s in silences_s:
        bad = (seen.latency_us > share * limit_us) | (seen.silent_us > round(silence_s * 1e6))
        rules = _Rules(pairs, weights, beats.period_us / 1e6, truth)
        code = bad.astype(np.int8) + 2 * forbidden.astype(np.int8) + 4 * held.astype(np.int8)
        bounds = [0, *(np.flatnonzero(np.diff(code)) + 1).tolist(), len(code)]
        for start, end in itertools.pairwise(bounds):
            now = int(code[start])
            rules.live(start, end, bad=bool(now & 1), forbidden=bool(now & 2), held=bool(now & 4))
        found += [
            RentOrBuy(silence_s, out, back, cost)
            for (out, back), cost in zip(pairs, rules.costs().tolist(), strict=True)
        ]
    return found


def _held(truth: NDArray[np.bool_], period_us: int, limit_us: int, window_s: float, share: float) -> NDArray[np.bool_]:
    """Return the periods in which a memory keeps every rule that is on the robot there."""
    window, late = round(window_s * 1e6 / period_us), -(-limit_us // period_us)
    bad = np.concatenate([np.zeros(window + late, dtype=np.int64), np.cumsum(~truth)])
    return np.asarray(bad[window : window + len(truth)] - bad[: len(truth)] > share * window)


class _Rules:
    """All rules of one signal side by side. Within a stretch of one signal each moves at most once."""

    def __init__(
        self, pairs: Sequence[tuple[float, float]], weights: Weights, period_s: float, truth: NDArray[np.bool_]
    ) -> None:
        self._weights, self._period_s = weights, period_s
        self._good = np.concatenate([[0], np.cumsum(truth)])
        self._cloud = np.zeros(len(pairs), dtype=bool)
        self._regret = np.zeros(len(pairs))
        limits = np.array(pairs) * weights.switch
        self._leave, self._return = limits[:, 0], limits[:, 1]
        self._exposed = np.zeros(len(pairs))
        self._wasted = np.zeros(len(pairs))
        self._switches = np.zeros(len(pairs))

    def costs(self) -> Floats:
        """Return J of each rule so far."""
        prices = self._weights
        periods = prices.exposed_per_s * self._exposed + prices.wasted_per_s * self._wasted
        return np.asarray(periods * self._period_s + prices.switch * self._switches)

    def live(self, start: int, end: int, *, bad: bool, forbidden: bool, held: bool) -> None:
        """Run the rules from period `start` to `end`, in which signal, limit and memory stay the same."""
        leave_per, return_per = self._per_period()
        if forbidden:
            self._switches += self._cloud
            self._regret[self._cloud] = 0.0
            self._cloud[:] = False
            self._account(start, end, np.full(len(self._cloud), end))
            step = -return_per if bad or held else return_per
            self._regret = np.maximum(0.0, self._regret + (end - start) * step)
            return
        moving = self._cloud if bad else ~self._cloud & (not held)
        per = leave_per if bad else return_per
        missing = (self._leave if bad else self._return) - self._regret
        periods = np.maximum(1.0, np.ceil(missing / per - ROUNDING))
        moves = moving & (periods <= end - start)
        at = np.where(moves, start - 1 + np.where(moves, periods, 1), end).astype(np.int64)
        self._account(start, end, at)
        self._switches += moves
        grown = self._regret + (end - start) * per
        melted = np.maximum(0.0, self._regret - (end - start) * np.where(self._cloud, leave_per, return_per))
        self._regret = np.where(moves, 0.0, np.where(moving, grown, melted))
        self._cloud ^= moves

    def _per_period(self) -> tuple[float, float]:
        return self._weights.exposed_per_s * self._period_s, self._weights.wasted_per_s * self._period_s

    def _account(self, start: int, end: int, moved_at: NDArray[np.int64]) -> None:
        """Charge each rule: until `moved_at` it is where it was, from then until `end` on the other side."""
        good, cloud = self._good, self._cloud
        good_before, good_after = good[moved_at] - good[start], good[end] - good[moved_at]
        bad_before, bad_after = moved_at - start - good_before, end - moved_at - good_after
        self._exposed += np.where(cloud, bad_before, bad_after)
        self._wasted += np.where(cloud, good_after, good_before)
