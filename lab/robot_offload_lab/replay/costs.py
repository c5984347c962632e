"""The price of a placement, and the lowest possible price with the whole recording known."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robot_offload_core.fence.token import Site
from robot_offload_lab.replay.heartbeats import Heartbeats


@dataclass(frozen=True)
class Weights:
    """Prices, in units of one second on the wrong but harmless side.

    Attributes:
        exposed_per_s: acting in the cloud while the link is not good enough.
        wasted_per_s: acting on the robot while it is.
        switch: one change of side.
    """

    exposed_per_s: float = 10.0
    wasted_per_s: float = 1.0
    switch: float = 0.5


@dataclass(frozen=True)
class Change:
    """A change of side: from `at_us` on, `site` acts."""

    at_us: int
    site: Site
    reason: str = ""
    message: str = ""


@dataclass(frozen=True)
class Score:
    """The price of a placement and its parts.

    Attributes:
        exposed_s: time in the cloud while the link was not good enough (for a heartbeat sent at that moment).
        wasted_s: time on the robot while it was.
        switches: changes of side; the robot acts at the beginning.
        cloud_pct: share of the time in the cloud.
        cost: J = exposed_per_s * exposed_s + wasted_per_s * wasted_s + switch * switches.
    """

    exposed_s: float
    wasted_s: float
    switches: int
    cloud_pct: float
    cost: float


def score(changes: Sequence[Change], beats: Heartbeats, limit_us: int, weights: Weights) -> Score:
    """Return the price of the placement `changes`; before the first change the robot acts."""
    stays = np.array(list(_cloud_stays(changes, beats.duration_us)), dtype=float).reshape(-1, 2)
    edges_us = np.arange(len(beats.sent_us) + 1) * beats.period_us
    good_us = np.concatenate([[0], np.cumsum(beats.good(limit_us)) * beats.period_us])
    good_until = np.interp(stays, edges_us, good_us)
    cloud_us = float(np.sum(stays[:, 1] - stays[:, 0]))
    cloud_good_us = float(np.sum(good_until[:, 1] - good_until[:, 0]))
    exposed_s = (cloud_us - cloud_good_us) / 1e6
    wasted_s = (float(good_us[-1]) - cloud_good_us) / 1e6
    cost = weights.exposed_per_s * exposed_s + weights.wasted_per_s * wasted_s + weights.switch * len(changes)
    return Score(exposed_s, wasted_s, len(changes), 100 * cloud_us / beats.duration_us, cost)


def optimum(
    beats: Heartbeats, limit_us: int, weights: Weights, forbidden: NDArray[np.bool_] | None = None
) -> tuple[Change, ...]:
    """Return the cheapest placement of all, found with the whole recording known.

    Dynamic programming over the stretches in which the link stays good or bad: within a stretch the cost of either side
    grows evenly, so the best moment for a change is always an edge. No policy without foresight can reach this price: a
    bad stretch shows only when its first echo is overdue, and a short one is over by then.

    Args:
        beats: of the recording.
        limit_us: the longest loop latency that is good enough.
        weights: the prices.
        forbidden: periods in which a hard limit keeps every policy on the robot; None for no limit.
    """
    good_enough = beats.good(limit_us)
    barred = np.zeros(len(good_enough), dtype=bool) if forbidden is None else forbidden
    kinds = good_enough + 2 * barred.astype(np.int8)
    parts = [(at_us, bool(kind & 1), bool(kind & 2), s) for at_us, kind, s in stretches(kinds, beats.period_us)]
    least = {Site.ROBOT: 0.0, Site.CLOUD: weights.switch}
    origins: list[dict[Site, Site]] = []
    for _, good, barred_here, length_s in parts:
        least[Site.CLOUD] += 0.0 if good else weights.exposed_per_s * length_s
        if barred_here:
            least[Site.CLOUD] = math.inf
        least[Site.ROBOT] += weights.wasted_per_s * length_s if good else 0.0
        # For each side at the end of this stretch: where the cheapest way to it was within the stretch.
        moving = {site: least[site.other] + weights.switch for site in Site}
        origins.append({site: site.other if moving[site] < least[site] else site for site in Site})
        least = {site: min(least[site], moving[site]) for site in Site}
    sites: list[Site] = []
    site = min(Site, key=lambda side: least[side])
    for origin in reversed(origins):
        site = origin[site]
        sites.append(site)
    starts_us = [part[0] for part in parts]
    return tuple(_as_changes(starts_us, sites[::-1]))


def _as_changes(starts_us: Sequence[int], sites: Sequence[Site]) -> Iterator[Change]:
    before = [Site.ROBOT, *sites[:-1]]
    for start_us, was, site in zip(starts_us, before, sites, strict=True):
        if site is not was:
            yield Change(start_us, site, "Foresight", "Known to be cheapest with the whole recording known")


def stretches(kinds: NDArray[np.bool_] | NDArray[np.int8], period_us: int) -> list[tuple[int, int, float]]:
    """Return (start in us, kind, length in s) of each stretch of periods of the same kind, for example good."""
    edges = np.flatnonzero(np.diff(kinds)) + 1
    bounds = [0, *edges.tolist(), len(kinds)]
    return [(a * period_us, int(kinds[a]), (b - a) * period_us / 1e6) for a, b in itertools.pairwise(bounds)]


def _cloud_stays(changes: Sequence[Change], end_us: int) -> Iterator[tuple[int, int]]:
    for index, change in enumerate(changes):
        if change.site is Site.CLOUD:
            yield change.at_us, changes[index + 1].at_us if index + 1 < len(changes) else end_us
