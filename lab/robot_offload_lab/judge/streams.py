"""What the arrivals of one output show by themselves: gaps, duplicates, reordering, losses, age.

Pure. Definitions, as the report and the benchmarks use them:

* duplicate: a (producer, sequence) that passed before;
* reordered: a message whose sequence is lower than one of the same producer that passed before, and no duplicate;
* stay: a run of consecutive arrivals of one producer (its stay in charge, as the consumer sees it), ended also by an
  announcement that the other side is in charge;
* lost: sequence numbers missing between the first and the last message of a stay. What a replica publishes while it
  is not in charge is not lost;
* stale: older than `maxCommandAge` when it passed to the consumers, by the time at which its replica published it;
* gap: the time between two consecutive arrivals of any producers.

A message that does not state its producer has only a time of arrival: for an output with such messages only gaps are
known.

A restarted producer counts from the beginning: a lower sequence that was published *later* than the highest one opens a
new life of that producer instead of counting as reordered.
"""

from __future__ import annotations

import bisect
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from robot_offload_lab.judge.recording import Arrival, Site

NO_DEPARTURES: Final[Mapping[Site, Sequence[float]]] = {}


@dataclass(frozen=True)
class Gap:
    """The silence between two consecutive arrivals, or between the last one and the end (`after` is None)."""

    before: Arrival
    after: Arrival | None
    end_s: float

    @property
    def start_s(self) -> float:
        """When the earlier message arrived."""
        return self.before.t_s

    @property
    def length_ms(self) -> float:
        """How long nothing arrived."""
        return (self.end_s - self.start_s) * 1e3


@dataclass(frozen=True)
class Hole:
    """Missing sequence numbers within a stay of `site`; `t_s` is the arrival of the next message."""

    t_s: float
    count: int
    site: Site


@dataclass(frozen=True)
class Stream:
    """The arrivals of one output with everything found in them."""

    topic: str
    arrivals: tuple[Arrival, ...]
    gaps: tuple[Gap, ...]
    duplicates: tuple[Arrival, ...]
    reordered: tuple[Arrival, ...]
    stale: tuple[Arrival, ...]
    holes: tuple[Hole, ...]

    @property
    def known(self) -> bool:
        """Whether duplicates, losses, order and age were measured: every message states its producer."""
        return all(arrival.named for arrival in self.arrivals)

    @property
    def lost(self) -> int:
        """Number of messages lost in all stays."""
        return sum(hole.count for hole in self.holes)


def examine(
    topic: str,
    arrivals: Sequence[Arrival],
    end_s: float,
    max_age_ms: float,
    departures: Mapping[Site, Sequence[float]] = NO_DEPARTURES,
) -> Stream:
    """Find everything in the arrivals of one output.

    Args:
        topic: the output.
        arrivals: in the order of arrival.
        end_s: later arrivals are left out.
        max_age_ms: an older message is stale.
        departures: for each side, the ascending times when the other side was announced to be in charge.
    """
    seen = tuple(arrival for arrival in arrivals if arrival.t_s <= end_s)
    lives = _lives(seen)
    duplicates, reordered = _order(seen, lives)
    return Stream(
        topic=topic,
        arrivals=seen,
        gaps=_gaps(seen, end_s),
        duplicates=duplicates,
        reordered=reordered,
        stale=tuple(arrival for arrival in seen if arrival.age_s * 1e3 > max_age_ms),
        holes=tuple(hole for stay in _stays(seen, lives, departures) for hole in _holes(stay)),
    )


def quantile(values: Sequence[float], share: float) -> float | None:
    """Return the `share` quantile (0..1) of `values`, linear between neighbours; None without values."""
    ordered = sorted(values)
    if not ordered:
        return None
    position = share * (len(ordered) - 1)
    low = int(position)
    high = min(low + 1, len(ordered) - 1)
    return ordered[low] + (ordered[high] - ordered[low]) * (position - low)


def _lives(arrivals: Sequence[Arrival]) -> tuple[int, ...]:
    """Return for each arrival which life of its producer it belongs to (0, 1, ...)."""
    highest: dict[str, Arrival] = {}
    life: dict[str, int] = {}
    lives = []
    for arrival in arrivals:
        top = highest.get(arrival.producer)
        if top is not None and arrival.sequence <= top.sequence and arrival.sent_t_s > top.sent_t_s:
            life[arrival.producer] = life.get(arrival.producer, 0) + 1
            top = None
        if top is None or arrival.sequence > top.sequence:
            highest[arrival.producer] = arrival
        lives.append(life.get(arrival.producer, 0))
    return tuple(lives)


def _order(arrivals: Sequence[Arrival], lives: Sequence[int]) -> tuple[tuple[Arrival, ...], tuple[Arrival, ...]]:
    """Return the duplicates and the reordered messages."""
    passed: set[tuple[str, int, int]] = set()
    highest: dict[tuple[str, int], int] = {}
    duplicates, reordered = [], []
    for arrival, life in zip(arrivals, lives, strict=True):
        producer, message = (arrival.producer, life), (arrival.producer, life, arrival.sequence)
        if message in passed:
            duplicates.append(arrival)
        elif arrival.sequence < highest.get(producer, arrival.sequence):
            reordered.append(arrival)
        passed.add(message)
        highest[producer] = max(arrival.sequence, highest.get(producer, arrival.sequence))
    return tuple(duplicates), tuple(reordered)


def _stays(
    arrivals: Sequence[Arrival], lives: Sequence[int], departures: Mapping[Site, Sequence[float]]
) -> list[list[Arrival]]:
    stays: list[list[Arrival]] = []
    current: tuple[str, int, int] | None = None
    for arrival, life in zip(arrivals, lives, strict=True):
        stay = (arrival.producer, life, bisect.bisect(departures.get(arrival.site, ()), arrival.t_s))
        if stay != current:
            stays.append([])
            current = stay
        stays[-1].append(arrival)
    return stays


def _holes(stay: Sequence[Arrival]) -> list[Hole]:
    """Return missing numbers of one stay; messages that came late (reordered) are not missing."""
    first_arrivals: dict[int, Arrival] = {}
    for arrival in stay:
        first_arrivals.setdefault(arrival.sequence, arrival)
    numbers = sorted(first_arrivals)
    return [
        Hole(first_arrivals[after].t_s, after - before - 1, first_arrivals[after].site)
        for before, after in itertools.pairwise(numbers)
        if after - before > 1
    ]


def _gaps(arrivals: Sequence[Arrival], end_s: float) -> tuple[Gap, ...]:
    """Return every silence, including that from the last arrival to the end."""
    gaps = [Gap(before, after, after.t_s) for before, after in itertools.pairwise(arrivals)]
    if arrivals:
        gaps.append(Gap(arrivals[-1], None, end_s))
    return tuple(gaps)
