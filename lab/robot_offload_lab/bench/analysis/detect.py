"""How soon a lost link is noticed, by the product and by its rivals, and how often one is reported wrongly."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from robot_offload_lab.bench.analysis.cuts import Cut, Fall
from robot_offload_lab.bench.results import Distribution, Figure, GroupResult, Priority, Sample, at_or_none, part, parts
from robot_offload_lab.bench.rivals import LIVELINESS, RIVALS, Rival, RivalReport
from robot_offload_lab.judge.measures import Interval

GROUP: Final = "detect"
OURS: Final = "Robot Offload"
UNSEEN: Final = 3.0
"""With none seen in a time, the true rate is with 95 % below this many in that time (the rule of three)."""


@dataclass(frozen=True)
class Variant:
    """One case of detection, for people.

    Attributes:
        name: a word.
        title: standby and heartbeat.
        conditions: of the link.
    """

    name: str
    title: str
    conditions: str


@dataclass(frozen=True)
class Judged:
    """What one detector made of a case, in milliseconds.

    Attributes:
        detector: for people.
        noticed: from each cut until its report; None where there was none before the link was mended.
        back: from the mending until it is reported that the other side is back.
        alarms: losses reported while nothing was cut; None where they were not watched for.
        gaps: of commands at the consumer; only the product's.
    """

    detector: str
    noticed: tuple[float | None, ...]
    back: tuple[float | None, ...]
    alarms: int | None
    gaps: tuple[float | None, ...] = ()


@dataclass(frozen=True)
class DetectionAccount:
    """A case with all its detectors; quiet is the time that was watched for false alarms."""

    variant: Variant
    quiet: Interval | None
    judged: tuple[Judged, ...]


def ours(falls: Sequence[Fall], alarms: int | None) -> Judged:
    """Return the product's result, from the outcome of each cut."""
    return Judged(
        OURS, tuple(f.noticed_ms for f in falls), tuple(f.back_ms for f in falls), alarms,
        tuple(f.gap_ms for f in falls),
    )  # fmt: skip


def rival(kind: Rival, reports: Sequence[RivalReport], cuts: Sequence[Cut], quiet: Interval | None) -> Judged:
    """Return a rival's result, from its reports. A cut shorter than the rival's patience does not count."""
    said = [one for one in reports if one.rival == kind.name]
    seen = [cut for cut in cuts if kind.patience_s is None or cut.healed_s - cut.cut_s > kind.patience_s]
    ends = {cut.number: after.cut_s for cut, after in itertools.pairwise(cuts)}
    noticed = [_first_ms(said, True, cut.cut_s, cut.healed_s) for cut in seen]
    back = [_first_ms(said, False, cut.healed_s, ends.get(cut.number, float("inf"))) for cut in seen]
    return Judged(kind.title, tuple(noticed), tuple(back), None if quiet is None else alarms(said, quiet))


def alarms(said: Sequence[RivalReport], quiet: Interval) -> int:
    """Return how often a loss was reported in a time without any."""
    return sum(one.lost and quiet.start_s <= one.t_s <= quiet.end_s for one in said)


def _first_ms(said: Sequence[RivalReport], lost: bool, from_s: float, to_s: float) -> float | None:
    return next(((one.t_s - from_s) * 1e3 for one in said if one.lost is lost and from_s <= one.t_s < to_s), None)


def per_hour(count: int, seconds: float) -> str:
    """Return a rate in words, honest about short times."""
    hours = seconds / 3600
    if not count:
        return f"none in {seconds / 60:.1f} minutes: below {UNSEEN / hours:.0f} per hour"
    return f"{count / hours:.0f} per hour, in {seconds / 60:.1f} minutes"


def outcome(priority: Priority, found: Sequence[DetectionAccount], refused: str) -> GroupResult:
    """Return the figures of all cases; `refused` says why the rivals did not run, empty when they did."""
    figures = [figure for account in found for figure in _figures(account)]
    if refused:
        figures += [
            Figure(
                f"missing_{kind.name}", f"{kind.title}: noticed", "all", None, 0, None, "ms", note=f"not run: {refused}"
            )
            for kind in RIVALS
        ]
    return GroupResult(GROUP, priority, tuple(figures), parts(_parts(found)), tuple(_samples(found)))


def _figures(account: DetectionAccount) -> Iterator[Figure]:
    variant = account.variant
    conditions = f"{variant.title}, {variant.conditions}"
    beside = next((j for j in account.judged if j.detector == LIVELINESS.title), None)
    for number, judged in enumerate(account.judged):
        name = f"{variant.name}_{number}"
        noticed = [value for value in judged.noticed if value is not None]
        if judged.noticed:
            base = at_or_none(beside.noticed, 0.5) if beside is not None and judged.detector == OURS else None
            yield Figure(
                f"{name}_noticed_p50", f"{judged.detector}: cut until noticed, p50", conditions, None, len(noticed),
                at_or_none(noticed, 0.5), "ms", note=_note(judged.noticed),
                baseline=base, against="" if base is None else LIVELINESS.title,
            )  # fmt: skip
        if judged.gaps:
            yield Figure(
                f"{name}_gap_p50", f"{judged.detector}: gap of commands, p50", conditions, None,
                sum(value is not None for value in judged.gaps), at_or_none(judged.gaps, 0.5), "ms",
                note=_note(judged.gaps),
            )  # fmt: skip
        if judged.alarms is not None and account.quiet is not None:
            yield Figure(
                f"{name}_alarms", f"{judged.detector}: false alarms", conditions, None, 1, judged.alarms, "alarms",
                note=per_hour(judged.alarms, account.quiet.length_s),
            )  # fmt: skip


def _note(values: Sequence[float | None]) -> str:
    known = [value for value in values if value is not None]
    words = [f"highest {max(known):.0f} ms"] if known else []
    if len(known) < len(values):
        words.append(f"{len(values) - len(known)} missed")
    return "; ".join(words)


def _parts(found: Sequence[DetectionAccount]) -> Iterator[Distribution | None]:
    for account in found:
        words = f"{account.variant.title}, {account.variant.conditions}"
        for judged in account.judged:
            yield part(f"{words}: {judged.detector}, cut until noticed", "ms", judged.noticed)
            yield part(f"{words}: {judged.detector}, mended until back", "ms", judged.back)
            yield part(f"{words}: {judged.detector}, gap", "ms", judged.gaps)


def _samples(found: Sequence[DetectionAccount]) -> Iterator[Sample]:
    for account in found:
        for judged in account.judged:
            gaps = judged.gaps or (None,) * len(judged.noticed)
            for number, values in enumerate(zip(judged.noticed, judged.back, gaps, strict=True), start=1):
                noticed, back, gap = values
                yield {
                    "variant": account.variant.name, "detector": judged.detector,
                    "series": f"{judged.detector}: {account.variant.title}, {account.variant.conditions}",
                    "cut": number, "noticed_ms": noticed, "back_ms": back, "gap_ms": gap,
                }  # fmt: skip
