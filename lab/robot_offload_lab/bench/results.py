"""The results of a measurement: figures and their limits, parts of figures, raw samples. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

from robot_offload_lab.judge.streams import quantile

Priority = Literal["realtime", "normal"]
PRIORITIES: Final[tuple[Priority, Priority]] = ("realtime", "normal")
Sample = Mapping[str, Any]


@dataclass(frozen=True)
class Figure:
    """One figure of the table.

    Attributes:
        name: unique in its group; for scripts.
        title: for people.
        conditions: those of the link and others that matter.
        tolerance_ms: `switching.latency.tolerance` of the case; None without a link case.
        count: number of samples behind it.
        value: None when nothing was measured.
        must, aim: limits in `unit`; None when none is demanded.
        at_least: whether the limits are lower ones.
        note: what else a reader must know.
        baseline: value for comparison, measured in the same run, in `unit`; None without one.
        against: the baseline in words.
    """

    name: str
    title: str
    conditions: str
    tolerance_ms: int | None
    count: int
    value: float | None
    unit: str
    must: float | None = None
    aim: float | None = None
    at_least: bool = False
    note: str = ""
    baseline: float | None = None
    against: str = ""

    @property
    def ratio(self) -> float | None:
        """The value as a multiple of the baseline; None without one."""
        if self.value is None or not self.baseline:
            return None
        return self.value / self.baseline

    @property
    def kept(self) -> str:
        """The best limit that the value keeps: `aim`, `must` or `missed`; empty when none was demanded or measured."""
        must, aim = self.met(self.must), self.met(self.aim)
        if aim:
            return "aim"
        if must:
            return "must"
        return "" if must is None else "missed"

    def met(self, limit: float | None) -> bool | None:
        """Return whether the value keeps a limit; None when there is no value or no limit."""
        if self.value is None or limit is None:
            return None
        return self.value >= limit if self.at_least else self.value <= limit


@dataclass(frozen=True)
class Distribution:
    """The distribution of one part of a figure, such as the detection within a gap."""

    title: str
    unit: str
    count: int
    p50: float
    p90: float
    p99: float
    highest: float


@dataclass(frozen=True)
class GroupResult:
    """The results of one group of figures with one priority."""

    group: str
    priority: Priority
    figures: tuple[Figure, ...]
    parts: tuple[Distribution, ...]
    samples: tuple[Sample, ...]


def part(title: str, unit: str, values: Iterable[float | None]) -> Distribution | None:
    """Return the distribution of the values that are known; None without any."""
    known = [value for value in values if value is not None]
    if not known:
        return None
    p50, p90, p99 = (at(known, share) for share in (0.5, 0.9, 0.99))
    return Distribution(title, unit, len(known), p50, p90, p99, max(known))


def parts(found: Iterable[Distribution | None]) -> tuple[Distribution, ...]:
    """Return the distributions that are not None."""
    return tuple(one for one in found if one is not None)


def at(values: Sequence[float], share: float) -> float:
    """Return a quantile of a list that is not empty."""
    value = quantile(values, share)
    assert value is not None
    return value


def at_or_none(values: Iterable[float | None], share: float) -> float | None:
    """Return a quantile of the values that are known; None without any."""
    return quantile([value for value in values if value is not None], share)
