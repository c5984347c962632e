"""Sudden cuts and what follows them.

For each cut, at the consumer and from the robot's announcements:

* noticed: from the cut to the decision;
* detection: from the last good beat to the decision, the agent's `silent_ms`. When only the way to the cloud
  is cut its beats stay good for a while, and this says little; there the latency rule may be first, which commands a
  switch without a gap;
* before: from the last command of the cloud that passed to that last good beat (negative: the command came later);
* activation: from the decision until the robot's node reports Active;
* timer phase: from there to the robot's first command at the consumer; its timer runs freely;
* gap: the sum, last command of the cloud to first command of the robot;
* first good beat: from the healing of the link to the first beat of the cloud that echoes, within the limit for a
  living loop, a beat of the robot that it serves;
* back: from the healing until the cloud is in charge again.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Final

from robot_offload_core.words import beats
from robot_offload_core.words.beats import CloudReport
from robot_offload_lab.bench.analysis import lease
from robot_offload_lab.bench.analysis.commanded import stream
from robot_offload_lab.bench.analysis.share import MUST_SHARE, cloud_share
from robot_offload_lab.bench.observed import BeatHeard, Observation, Transition, only
from robot_offload_lab.bench.resource import COMMAND, BenchCase
from robot_offload_lab.bench.results import Distribution, Figure, GroupResult, Priority, at_or_none, part, parts
from robot_offload_lab.judge.measures import Interval
from robot_offload_lab.judge.recording import Arrival, PlacementChange, Recording

GROUP: Final = "cuts"
MUST_EXTRA_MS: Final = 50.0
AIM_EXTRA_MS: Final = 30.0
HEAL_MUST_S: Final = 1.0
HEAL_AIM_S: Final = 0.6
DIRECTIONS: Final = {"both": "both directions", "up": "robot to cloud only", "down": "cloud to robot only"}


@dataclass(frozen=True)
class Cut:
    """What was done to the link.

    Attributes:
        direction: `both`, `up` (robot to cloud) or `down`.
        length_s: how long it was to last.
        cut_s: just after it was cut.
        healed_s: just before it was mended.
    """

    number: int
    direction: str
    length_s: float
    cut_s: float
    healed_s: float


@dataclass(frozen=True)
class Fall:
    """The outcome of a cut. Times in milliseconds, None where a moment was not seen."""

    number: int
    direction: str
    length_s: float
    reason: str
    noticed_ms: float | None
    detection_ms: float | None
    before_ms: float | None
    activation_ms: float | None
    phase_ms: float | None
    gap_ms: float | None
    first_good_beat_ms: float | None
    back_ms: float | None


@dataclass(frozen=True)
class CutAccount:
    """What is needed to judge cuts.

    Attributes:
        cuts: in the order of time.
        recording: of the consumer.
        robot: of the witness on the robot.
        lease: of the observer at the cloud agent.
        loop_limit_s: oldest echo that proves a living loop (loss timeout + allowed loop latency).
        lease_s: `switching.lease`.
    """

    cuts: tuple[Cut, ...]
    recording: Recording
    robot: tuple[Observation, ...]
    lease: tuple[Observation, ...]
    loop_limit_s: float
    lease_s: float


def falls(account: CutAccount) -> tuple[Fall, ...]:
    """Return the outcome of each cut."""
    placements = only(PlacementChange, account.robot)
    active = [event.t_s for event in only(Transition, account.robot) if event.state == "active"]
    good = good_beats(account.robot, account.loop_limit_s)
    arrivals = account.recording.outputs.get(COMMAND, ())
    ends = [*(cut.cut_s for cut in account.cuts[1:]), float("inf")]
    return tuple(
        _fall(cut, end_s, placements, active, good, arrivals) for cut, end_s in zip(account.cuts, ends, strict=True)
    )


def good_beats(observations: Sequence[Observation], limit_s: float) -> tuple[float, ...]:
    """Return when beats arrived that prove a living loop."""
    return tuple(heard.t_s for heard in only(BeatHeard, observations) if _is_good(heard, limit_s))


def _is_good(heard: BeatHeard, limit_s: float) -> bool:
    try:
        beat = beats.decode(heard.text)
    except beats.BeatError:
        return False
    echo, report = beat.echo, beat.body
    if echo is None or not isinstance(report, CloudReport) or report.serves != echo.incarnation:
        return False
    return heard.t_s - echo.sent_us / 1e6 <= limit_s


def _fall(
    cut: Cut, end_s: float, placements: Sequence[PlacementChange], active: Sequence[float], good: Sequence[float],
    arrivals: Sequence[Arrival],
) -> Fall:  # fmt: skip
    taken = next((p for p in placements if p.site == "robot" and cut.cut_s <= p.decided_s < end_s), None)
    first_good_s = next((t_s for t_s in good if cut.healed_s <= t_s < end_s), None)
    back = next((p for p in placements if p.site == "cloud" and cut.healed_s <= p.decided_s < end_s), None)
    since = {
        "first_good_beat_ms": _ms(cut.healed_s, first_good_s),
        "back_ms": _ms(cut.healed_s, back.decided_s if back else None),
    }
    if taken is None:
        return Fall(cut.number, cut.direction, cut.length_s, "", None, None, None, None, None, None, **since)
    decided_s = taken.decided_s
    last_good_s = None if taken.detect_ms is None else decided_s - taken.detect_ms / 1e3
    first = next((a for a in arrivals if a.site == "robot" and cut.cut_s <= a.t_s < end_s), None)
    last = next((a for a in reversed(arrivals) if a.site == "cloud" and (first is None or a.t_s < first.t_s)), None)
    active_s = next((t_s for t_s in active if decided_s <= t_s and (first is None or t_s <= first.t_s)), None)
    return Fall(
        number=cut.number,
        direction=cut.direction,
        length_s=cut.length_s,
        reason=taken.reason,
        noticed_ms=_ms(cut.cut_s, decided_s),
        detection_ms=taken.detect_ms,
        before_ms=_ms(last.t_s if last else None, last_good_s),
        activation_ms=_ms(decided_s, active_s),
        phase_ms=_ms(active_s, first.t_s if first else None),
        gap_ms=_ms(last.t_s if last else None, first.t_s if first else None),
        **since,
    )


def _ms(from_s: float | None, to_s: float | None) -> float | None:
    return None if from_s is None or to_s is None else (to_s - from_s) * 1e3


def good_intervals(account: CutAccount) -> tuple[Interval, ...]:
    """Return when the link was not cut, from the first cut's own beginning of good time on."""
    begin_s = account.recording.run.start_s
    found = []
    for cut in account.cuts:
        found.append(Interval(begin_s, cut.cut_s))
        begin_s = cut.healed_s
    return (*found, Interval(begin_s, account.recording.end_s))


def outcome(case: BenchCase, priority: Priority, account: CutAccount) -> GroupResult:
    """Return the figures of a run of cuts."""
    found = falls(account)
    return GroupResult(
        group=GROUP,
        priority=priority,
        figures=(*_gaps(case, account, found), *_heals(case, found), *_safety(case, account, found)),
        parts=parts(_parts(found)),
        samples=tuple(asdict(fall) for fall in found),
    )


def _gaps(case: BenchCase, account: CutAccount, found: Sequence[Fall]) -> Iterator[Figure]:
    run = account.recording.run
    limit_ms = run.loss_timeout_ms + run.robot_period_ms
    for direction, words in DIRECTIONS.items():
        there = [fall for fall in found if fall.direction == direction]
        gaps = [fall.gap_ms for fall in there if fall.gap_ms is not None]
        if there:
            missing = len(there) - len(gaps)
            yield Figure(
                f"gap_{direction}_p99", f"Sudden cut ({words}), Warm standby: last cloud command to first robot "
                "command, p99", case.describe(), case.tolerance_ms, len(gaps), at_or_none(gaps, 0.99), "ms",
                limit_ms + MUST_EXTRA_MS, limit_ms + AIM_EXTRA_MS,
                note=f"{missing} cuts without a takeover" if missing else "",
            )  # fmt: skip


def _heals(case: BenchCase, found: Sequence[Fall]) -> Iterator[Figure]:
    for length_s in sorted({fall.length_s for fall in found}):
        there = [fall for fall in found if fall.length_s == length_s]
        heals = [fall.first_good_beat_ms for fall in there if fall.first_good_beat_ms is not None]
        value = at_or_none(heals, 0.9)
        missing = len(there) - len(heals)
        yield Figure(
            f"heal_{length_s:g}s_p90", f"First good beat after a cut of {length_s:g} s, p90", case.describe(),
            case.tolerance_ms, len(heals), None if value is None else value / 1e3, "s", HEAL_MUST_S, HEAL_AIM_S,
            note=f"{missing} cuts without one" if missing else "",
        )  # fmt: skip


def _safety(case: BenchCase, account: CutAccount, found: Sequence[Fall]) -> Iterator[Figure]:
    run, count = account.recording.run, len(found)
    seen = stream(account.recording)
    yield Figure(
        "stale", f"Commands older than {run.max_command_age_ms:g} ms that reach the consumer", case.describe(),
        case.tolerance_ms, count, len(seen.stale), "messages", 0, 0, note=f"of {len(seen.arrivals)} messages",
    )  # fmt: skip
    yield Figure(
        "repeated", "Duplicates and reordered commands", case.describe(), case.tolerance_ms, count,
        len(seen.duplicates) + len(seen.reordered), "messages", 0, 0, note=f"of {len(seen.arrivals)} messages",
    )  # fmt: skip
    left = lease.leavings(account.lease, account.lease_s, run.start_s)
    late = [leaving.late_s for leaving in left if leaving.late_s is not None]
    nearest = f"; the nearest left {-max(late) * 1e3:.0f} ms before its end" if late else ""
    yield Figure(
        "after_lease", "Envelopes that left the cloud agent after its lease", case.describe(), case.tolerance_ms,
        len(left), sum(leaving.violates for leaving in left), "messages", 0, note=f"{count} cuts{nearest}",
    )  # fmt: skip
    share = cloud_share(only(PlacementChange, account.robot), good_intervals(account))
    yield Figure(
        "cloud_share", "Share of the good time with the cloud in charge", case.describe(), case.tolerance_ms, count,
        None if share is None else share * 100, "%", MUST_SHARE * 100, at_least=True,
    )  # fmt: skip


def _parts(found: Sequence[Fall]) -> Iterator[Distribution | None]:
    for direction, words in DIRECTIONS.items():
        there = [fall for fall in found if fall.direction == direction]
        yield part(f"{words}: noticed (cut until decision)", "ms", (f.noticed_ms for f in there))
        yield part(f"{words}: last command until last good beat", "ms", (f.before_ms for f in there))
        yield part(f"{words}: detection (last good beat until decision)", "ms", (f.detection_ms for f in there))
        yield part(f"{words}: activation (decision until Active)", "ms", (f.activation_ms for f in there))
        yield part(f"{words}: timer phase (Active until first command)", "ms", (f.phase_ms for f in there))
        yield part(f"{words}: gap", "ms", (f.gap_ms for f in there))
    yield part("after the heal: first good beat", "ms", (f.first_good_beat_ms for f in found))
    yield part("after the heal: cloud in charge again", "ms", (f.back_ms for f in found))
