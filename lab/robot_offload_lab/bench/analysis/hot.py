"""Hot standby: what a consumer misses at a sudden cut, and at a commanded change.

The gap is the time from the last command of the old side to the first of the new one. A jitter of the link tears gaps
into the cloud's own commands as well, without any change: their distances stand beside.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from robot_offload_lab.bench.analysis.commanded import stream
from robot_offload_lab.bench.analysis.cuts import CutAccount, Fall, falls
from robot_offload_lab.bench.observed import Answered, only
from robot_offload_lab.bench.resource import COMMAND, BenchCase
from robot_offload_lab.bench.results import Distribution, Figure, GroupResult, Priority, Sample, at_or_none, part, parts
from robot_offload_lab.judge.recording import Arrival

GROUP: Final = "hot"
MUST_EXTRA_MS: Final = 25.0
AIM_EXTRA_MS: Final = 45.0
CHANGE_EXTRA_MS: Final = 3.0


@dataclass(frozen=True)
class HotChange:
    """One commanded change.

    Attributes:
        to: the new side.
        gap_ms: last command of the old side to the first of the new one.
    """

    to: str
    gap_ms: float


def changes(account: CutAccount) -> tuple[HotChange, ...]:
    """Return the commanded changes: those of before the first cut."""
    until_s = account.cuts[0].cut_s if account.cuts else float("inf")
    asked = [a.asked_s for a in only(Answered, account.robot) if a.accepted and a.asked_s < until_s]
    arrivals = [a for a in account.recording.outputs.get(COMMAND, ()) if asked and asked[0] <= a.t_s < until_s]
    return tuple(
        HotChange(later.site, (later.t_s - earlier.t_s) * 1e3)
        for earlier, later in itertools.pairwise(arrivals)
        if earlier.site != later.site
    )


def outcome(case: BenchCase, priority: Priority, account: CutAccount) -> GroupResult:
    """Return the figures of a run with commanded changes and cuts."""
    found, changed = falls(account), changes(account)
    return GroupResult(
        group=GROUP,
        priority=priority,
        figures=(*_cuts(case, found), *_changes(case, changed), _faults(case, account)),
        parts=parts(_parts(account.recording.outputs.get(COMMAND, ()), found, changed)),
        samples=tuple(_samples(found, changed)),
    )


def _cuts(case: BenchCase, found: Sequence[Fall]) -> Iterator[Figure]:
    gaps = [fall.gap_ms for fall in found if fall.gap_ms is not None]
    reasons = Counter(fall.reason or "no takeover" for fall in found)
    cloud_ms = 1000.0 / case.cloud_rate_hz
    yield Figure(
        "gap_p99", "Sudden cut, Hot standby: last cloud command to the next command, p99", case.describe(),
        case.tolerance_ms, len(gaps), at_or_none(gaps, 0.99), "ms", case.robot_period_ms + MUST_EXTRA_MS,
        cloud_ms + AIM_EXTRA_MS, note=", ".join(f"{count} {reason}" for reason, count in reasons.most_common()),
    )  # fmt: skip


def _changes(case: BenchCase, changed: Sequence[HotChange]) -> Iterator[Figure]:
    longest = max((change.gap_ms for change in changed), default=None)
    yield Figure(
        "change_longest", "Commanded change between Hot sides: longest gap between the two", case.describe(),
        case.tolerance_ms, len(changed), longest, "ms", case.robot_period_ms + CHANGE_EXTRA_MS,
    )  # fmt: skip


def _faults(case: BenchCase, account: CutAccount) -> Figure:
    seen = stream(account.recording)
    faults = len(seen.stale) + len(seen.duplicates) + len(seen.reordered)
    return Figure(
        "faults", "Duplicates, reordered and stale commands", case.describe(), case.tolerance_ms, len(account.cuts),
        faults, "messages", 0, note=f"of {len(seen.arrivals)} messages",
    )  # fmt: skip


def _samples(found: Sequence[Fall], changed: Sequence[HotChange]) -> Iterator[Sample]:
    for fall in found:
        yield {
            "kind": "cut",
            "to": "robot",
            "reason": fall.reason,
            "noticed_ms": fall.noticed_ms,
            "gap_ms": fall.gap_ms,
        }
    for change in changed:
        yield {"kind": "change", "to": change.to, "reason": "", "noticed_ms": None, "gap_ms": change.gap_ms}


def _parts(
    arrivals: Sequence[Arrival], found: Sequence[Fall], changed: Sequence[HotChange]
) -> Iterator[Distribution | None]:
    yield part("sudden cut: last command until last good beat", "ms", (fall.before_ms for fall in found))
    yield part("sudden cut: noticed (cut until decision)", "ms", (fall.noticed_ms for fall in found))
    yield part("sudden cut: gap", "ms", (fall.gap_ms for fall in found))
    for to in ("robot", "cloud"):
        yield part(f"commanded change to the {to}: gap", "ms", (c.gap_ms for c in changed if c.to == to))
        alike = ((b.t_s - a.t_s) * 1e3 for a, b in itertools.pairwise(arrivals) if a.site == b.site == to)
        yield part(f"distance of two commands of the {to}, no change between them", "ms", alike)
