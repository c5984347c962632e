"""The hard limits that every policy must respect in a replay: the cloud never acts over a silent link."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robot_offload_core.fence.token import Site
from robot_offload_lab.links.recorded import Trace
from robot_offload_lab.replay.costs import Change
from robot_offload_lab.replay.heartbeats import NEVER_US, Heartbeats

LOSS_FLOOR_S: Final = 0.090
LOSS_FACTOR: Final = 3.0
REASON: Final = "HeartbeatLost"


def adapted_loss_timeout_s(trace: Trace) -> float:
    """Return the silence that means a lost link here: 90 ms, or three medians where the path is slow."""
    return max(LOSS_FLOOR_S, LOSS_FACTOR * trace.median_ms / 1e3)


@dataclass(frozen=True)
class Newest:
    """What had arrived by the beginning of each period.

    Attributes:
        silent_us: time since the newest arrival (before the first one: since the beginning).
        latency_us: latency of the newest beat that had arrived; NEVER_US before the first one.
    """

    silent_us: NDArray[np.int64]
    latency_us: NDArray[np.int64]


def newest(beats: Heartbeats) -> Newest:
    """Return what a causal rule may know at the beginning of each period."""
    back = beats.arrived_us != NEVER_US
    arrived_us, latency_us = beats.arrived_us[back], beats.latency_us[back]
    index = np.searchsorted(arrived_us, beats.sent_us, side="right") - 1
    known = index >= 0
    last_us = np.where(known, arrived_us[index], 0)
    return Newest(beats.sent_us - last_us, np.where(known, latency_us[index], NEVER_US))


def forbidden(beats: Heartbeats, loss_timeout_us: int) -> NDArray[np.bool_]:
    """Return for each period whether, when it began, nothing had come for the loss timeout."""
    return newest(beats).silent_us > loss_timeout_us


def clamped(changes: tuple[Change, ...], beats: Heartbeats, loss_timeout_us: int) -> tuple[Change, ...]:
    """Return the placement `changes`, but leave the cloud at once in silence; afterwards the policy decides again."""
    silences = list(_silences(beats, loss_timeout_us))
    if not silences:
        return changes
    moments: list[tuple[int, int, Change | None]] = [(change.at_us, 2, change) for change in changes]
    moments += [(start_us, 0, None) for start_us, _ in silences]
    moments += [(end_us, 1, None) for _, end_us in silences if end_us < beats.duration_us]
    message = f"The hard limit: nothing has come for {loss_timeout_us / 1e3:g} ms"
    found: list[Change] = []
    wish, silent, site = Change(0, Site.ROBOT), False, Site.ROBOT
    for at_us, together in itertools.groupby(sorted(moments, key=lambda moment: moment[:2]), key=lambda m: m[0]):
        for _, kind, change in together:
            wish = change or wish
            silent = silent if change else kind == 0
        wanted = Site.ROBOT if silent else wish.site
        if wanted is site:
            continue
        site = wanted
        if silent and wish.site is Site.CLOUD:
            found.append(Change(at_us, site, REASON, message))
        else:
            found.append(Change(at_us, site, wish.reason, wish.message))
    return tuple(found)


def _silences(beats: Heartbeats, loss_timeout_us: int) -> list[tuple[int, int]]:
    """Return (from, until) of each stretch in which the cloud is forbidden, up to the next arrival."""
    silent = forbidden(beats, loss_timeout_us)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], silent, [False]]).astype(np.int8)))
    arrived_us = beats.arrived_us[beats.arrived_us != NEVER_US]
    found = []
    for start, _ in edges.reshape(-1, 2).tolist():
        start_us = start * beats.period_us
        after = int(np.searchsorted(arrived_us, start_us, side="right"))
        found.append((start_us, int(arrived_us[after]) if after < len(arrived_us) else beats.duration_us))
    return found
