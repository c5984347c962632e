"""State: what the robot's node goes on from after a sudden cut.

* age at the cut: from the making of the snapshot that the robot's node woke with until the cut;
* restore: from the node's waking until its first message, with the snapshot taken in between;
* gap: from the last message of the cloud that passed until the robot's first.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from robot_offload_lab.bench.observed import FirstOutput, Observation, SnapshotTaken, Woken, only
from robot_offload_lab.bench.resource import COMMAND, BenchCase
from robot_offload_lab.bench.results import Distribution, Figure, GroupResult, Priority, Sample, at_or_none, part, parts
from robot_offload_lab.judge.recording import Recording

GROUP: Final = "keeping"
AGE_LIMITS_MS: Final = {1024: (200.0, 120.0), 1024 * 1024: (400.0, 250.0)}
"""Size in bytes -> must, aim; of 10 snapshots a second."""
MIB: Final = 1024 * 1024


@dataclass(frozen=True)
class StateAccount:
    """A run with one size. `cuts_s`: moments. `kept`: what the robot's node took down."""

    case: BenchCase
    cuts_s: tuple[float, ...]
    kept: tuple[Observation, ...]
    recording: Recording


@dataclass(frozen=True)
class Restore:
    """What followed a cut; None where it was not seen: clean start, no message.

    Attributes:
        age_ms: of the snapshot at the cut.
        restore_ms: waking until the first message.
        gap_ms: last message of the cloud until the robot's first.
    """

    age_ms: float | None
    restore_ms: float | None
    gap_ms: float | None


def restores(account: StateAccount) -> tuple[Restore, ...]:
    """Return what followed each cut."""
    return tuple(_restore(account, cut_s) for cut_s in account.cuts_s)


def _restore(account: StateAccount, cut_s: float) -> Restore:
    woken = next((w.t_s for w in only(Woken, account.kept) if w.t_s >= cut_s), None)
    if woken is None:
        return Restore(None, None, None)
    first = next((f.t_s for f in only(FirstOutput, account.kept) if f.t_s >= woken), None)
    taken = next((s for s in only(SnapshotTaken, account.kept) if s.t_s >= woken), None)
    if taken is None or first is None or taken.t_s > first:
        return Restore(None, None, None)
    arrivals = account.recording.outputs.get(COMMAND, ())
    last = max((a.t_s for a in arrivals if a.site == "cloud" and a.t_s < first), default=None)
    begun = min((a.t_s for a in arrivals if a.site == "robot" and a.t_s > woken), default=None)
    gap_ms = (begun - last) * 1e3 if last is not None and begun is not None else None
    return Restore((cut_s - taken.made_s) * 1e3, (first - woken) * 1e3, gap_ms)


def size_in_words(size: int) -> str:
    """Return a size as people say it."""
    return f"{size / MIB:.0f} MiB" if size > MIB / 2 else f"{size / 1024:.0f} KiB"


def outcome(priority: Priority, accounts: Sequence[StateAccount]) -> GroupResult:
    """Return the figures of all sizes."""
    found = [(account, restores(account)) for account in accounts]
    return GroupResult(
        GROUP, priority, tuple(figure for one in found for figure in _figures(*one)),
        parts(piece for one in found for piece in _parts(*one)),
        tuple(sample for one in found for sample in _samples(*one)),
    )  # fmt: skip


def _figures(account: StateAccount, found: Sequence[Restore]) -> Iterator[Figure]:
    case = account.case
    size, where = size_in_words(case.state_bytes), (account.case.describe(), account.case.tolerance_ms)
    ages = [one.age_ms for one in found if one.age_ms is not None]
    must, aim = AGE_LIMITS_MS.get(case.state_bytes, (None, None))
    yield Figure(
        f"age_{case.name}", f"State of {size}: age at a sudden cut, p99", *where, len(ages), at_or_none(ages, 0.99),
        "ms", must, aim, note=f"{case.state_rate_hz:g} a second; {len(found) - len(ages)} began clean",
    )  # fmt: skip
    times = [one.restore_ms for one in found if one.restore_ms is not None]
    yield Figure(
        f"restore_{case.name}", f"State of {size}: the node's waking to its first message, p99", *where, len(times),
        at_or_none(times, 0.99), "ms",
        note=f"of these up to {case.robot_period_ms:.0f} ms are the phase of the node's timer",
    )  # fmt: skip


def _parts(account: StateAccount, found: Sequence[Restore]) -> Iterator[Distribution | None]:
    size = size_in_words(account.case.state_bytes)
    yield part(f"{size}: age at the cut", "ms", (one.age_ms for one in found))
    yield part(f"{size}: waking to first message", "ms", (one.restore_ms for one in found))
    yield part(f"{size}: last message of the cloud to the robot's first", "ms", (one.gap_ms for one in found))


def _samples(account: StateAccount, found: Sequence[Restore]) -> Iterator[Sample]:
    for one in found:
        yield {
            "case": account.case.name,
            "age_ms": one.age_ms,
            "restore_ms": one.restore_ms,
            "gap_ms": one.gap_ms,
        }
