"""What must hold in every run, judged from a recording made at the consumer. Pure.

These are the promises of the switching protocol as far as a consumer can see them. Collisions and the goal are
reported beside them: they depend on the application too. Each violation is a sentence with its time and figures.

* `Duplicate`: no message passes twice.
* `Reordered`: the messages of one replica pass in their order.
* `Interleaved`: a side that is not in charge is not heard; `interleaving` lists what is not counted.
* `Stale`: nothing from the cloud passes that is older than maxCommandAge. What the robot's own replica publishes never
  crosses the link; its delays are counted in the report, and a long one is a `Gap`.
* `Gap`: no silence is longer than lossTimeout + activationDeadline + the slower period + 200 ms, not counting the
  time in which the driver was inhibited (then the robot stands and nothing may be expected). Outputs without a rate
  or with a condition (`while`) are not judged: the feedback of the goals is.
* `Lost`: a commanded switch over a good link loses nothing from the cloud (what the robot's own replica loses on the
  robot is counted in the report). Not judged when the switch was commanded because the agents found the loop too slow:
  a busy computer delays like a bad link, and what is too old must not pass.
* `Unused`: the cloud acts at some time unless the link forbids that. An input without a publisher, another type, or a
  replica that does not get ready are mistakes of the specification; the agent's message names the culprit.
* `Epoch`: every change of the side in charge has a higher epoch.

The promises about goals, calls and state are in `handed`.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from robot_offload_core.words.reasons import Reason
from robot_offload_lab.judge import handed, interleaving
from robot_offload_lab.judge.measures import SWITCH_WINDOW_S, Interval, Measures, link_was_good
from robot_offload_lab.judge.recording import Arrival, PlacementChange, Recording
from robot_offload_lab.judge.streams import Gap, Stream

OFFLOAD = "offload"
"""The mode in which the agents may use both sides."""
GAP_MARGIN_MS = 200.0
"""What a busy computer adds to the sum of the declared times: scheduling, the middleware, the recorder itself."""

MISTAKES = frozenset({
    Reason.INPUT_STALE, Reason.CONFIGURATION_DIFFERS, Reason.INPUTS_DIFFER,
    Reason.CLOUD_NOT_READY, Reason.TYPES_DIFFER, Reason.SECOND_PUBLISHER,
    Reason.UNDECLARED_PUBLISHER, Reason.SECOND_LIFECYCLE_MANAGER, Reason.REPLICA_PARAMETERS_DIFFER,
})  # fmt: skip
"""Reasons against the cloud that the link cannot explain."""
LEAST_RUN_S = 10.0
"""A shorter run does not prove that a side is never used."""


@dataclass(frozen=True)
class Violation:
    """One broken promise.

    Attributes:
        t_s: when, counted from the start of the run.
        kind: one word, see the list at the top of the module.
        text: a sentence with time and figures.
    """

    t_s: float
    kind: str
    text: str


def violations(measures: Measures) -> tuple[Violation, ...]:
    """Return every broken promise of a run, in the order of time."""
    found: list[Violation] = []
    for stream in measures.streams.values():
        found += _duplicates(measures, stream)
        found += _reordered(measures, stream)
        found += _interleaved(measures, stream)
        found += _stale(measures, stream)
        found += _gaps(measures, stream)
    found += _lost(measures)
    found += _epochs(measures)
    found += _unused(measures)
    found += _handed(measures)
    return tuple(sorted(found, key=lambda violation: violation.t_s))


def gap_limit_ms(recording: Recording) -> float:
    """Return the longest silence of an output that the run's settings explain."""
    run = recording.run
    slower_ms = max(run.robot_period_ms, run.cloud_period_ms)
    return run.loss_timeout_ms + run.activation_deadline_ms + slower_ms + GAP_MARGIN_MS


def _duplicates(measures: Measures, stream: Stream) -> Iterator[Violation]:
    if stream.duplicates:
        first = stream.duplicates[0]
        t_s = _since_start(measures, first.t_s)
        yield Violation(
            t_s,
            "Duplicate",
            f"{_messages(len(stream.duplicates))} of {stream.topic} passed twice, the first, {_named(first)}, at "
            f"{t_s:.3f} s.",
        )


def _reordered(measures: Measures, stream: Stream) -> Iterator[Violation]:
    if stream.reordered:
        first = stream.reordered[0]
        t_s = _since_start(measures, first.t_s)
        yield Violation(
            t_s,
            "Reordered",
            f"{_messages(len(stream.reordered))} of {stream.topic} came after a later one of the same replica, "
            f"the first, {_named(first)}, at {t_s:.3f} s.",
        )


def _stale(measures: Measures, stream: Stream) -> Iterator[Violation]:
    stale = [arrival for arrival in stream.stale if arrival.site == "cloud"]
    if stale:
        first, oldest = stale[0], max(stale, key=lambda arrival: arrival.age_s)
        t_s = _since_start(measures, first.t_s)
        yield Violation(
            t_s,
            "Stale",
            f"{_messages(len(stale))} of {stream.topic} from the cloud passed older than "
            f"{measures.recording.run.max_command_age_ms:g} ms, the first, {_named(first)}, at {t_s:.3f} s with "
            f"{first.age_s * 1e3:.1f} ms; the oldest had {oldest.age_s * 1e3:.1f} ms.",
        )


def _interleaved(measures: Measures, stream: Stream) -> Iterator[Violation]:
    """Yield one violation per stay in which the other side was heard after the new one."""
    for found in interleaving.interleavings(stream.arrivals, measures.recording.placements):
        first, site = found.heard[0], found.stay.site
        t_s, begun_s = (_since_start(measures, arrival.t_s) for arrival in (first, found.begun))
        yield Violation(
            t_s,
            "Interleaved",
            f"{_messages(len(found.heard))} of {stream.topic} from the {first.site} passed after the {site} had taken "
            f"over (epoch {found.stay.epoch}, first heard with {_named(found.begun)} at {begun_s:.3f} s), the first, "
            f"{_named(first)}, at {t_s:.3f} s.",
        )


def _gaps(measures: Measures, stream: Stream) -> Iterator[Violation]:
    if stream.topic in measures.recording.run.silent:
        return
    limit_ms = gap_limit_ms(measures.recording)
    held = inhibited(measures.recording)
    for gap in stream.gaps:
        if gap.length_ms <= limit_ms:
            continue
        unexplained_ms = _unexplained_ms(gap, held)
        if unexplained_ms <= limit_ms:
            continue
        t_s = _since_start(measures, gap.start_s)
        ended = f"until {_named(gap.after)} came" if gap.after else "until the end of the run"
        yield Violation(
            t_s,
            "Gap",
            f"{stream.topic} was silent for {gap.length_ms:.0f} ms from {t_s:.3f} s {ended}; "
            f"{unexplained_ms:.0f} ms of it without the driver being inhibited, more than the {limit_ms:.0f} ms "
            "that detection, activation and one period explain.",
        )


def inhibited(recording: Recording) -> list[Interval]:
    """Return when the driver held the wheels because no core node was able to steer."""
    intervals: list[Interval] = []
    since_s: float | None = None
    for change in recording.inhibits:
        if change.inhibited and since_s is None:
            since_s = change.t_s
        elif not change.inhibited and since_s is not None:
            intervals.append(Interval(since_s, change.t_s))
            since_s = None
    if since_s is not None:
        intervals.append(Interval(since_s, recording.end_s))
    return intervals


def _unexplained_ms(gap: Gap, held: Sequence[Interval]) -> float:
    """Return the longest part of a gap in which the driver was not inhibited."""
    longest_s, since_s = 0.0, gap.start_s
    for interval in held:
        if interval.end_s <= gap.start_s or interval.start_s >= gap.end_s:
            continue
        longest_s = max(longest_s, interval.start_s - since_s)
        since_s = max(since_s, interval.end_s)
    return max(longest_s, gap.end_s - since_s) * 1e3


def _lost(measures: Measures) -> Iterator[Violation]:
    for switch in measures.switches:
        start_s, end_s = switch.t_s - SWITCH_WINDOW_S, switch.t_s + SWITCH_WINDOW_S
        lost = _lost_from_cloud(measures, start_s, end_s)
        known_link = bool(measures.recording.link)
        if not switch.commanded or not lost or switch.change.reason == Reason.LATENCY_TOO_HIGH:
            continue
        if known_link and not link_was_good(measures.recording, start_s, end_s):
            continue
        t_s = _since_start(measures, switch.t_s)
        yield Violation(
            t_s,
            "Lost",
            f"The commanded switch from {switch.before} to {switch.after} at {t_s:.3f} s lost "
            f"{_messages(lost)} from the cloud over a good link.",
        )


def _lost_from_cloud(measures: Measures, start_s: float, end_s: float) -> int:
    return sum(
        hole.count
        for stream in measures.streams.values()
        for hole in stream.holes
        if hole.site == "cloud" and start_s <= hole.t_s <= end_s
    )


def _epochs(measures: Measures) -> Iterator[Violation]:
    for switch, before in _switches_with_predecessor(measures.recording):
        if switch.epoch <= before.epoch:
            t_s = _since_start(measures, switch.t_s)
            yield Violation(
                t_s,
                "Epoch",
                f"The switch from {before.site} to {switch.site} at {t_s:.3f} s went from epoch {before.epoch} to "
                f"{switch.epoch}; every changeover must have a higher one.",
            )


def _unused(measures: Measures) -> Iterator[Violation]:
    """Yield what kept the cloud out for the whole run if that is a mistake of the specification.

    An input that was received for a while and then grew old on the way is a matter of the link.
    """
    placements = measures.recording.placements
    if measures.recording.run.mode != OFFLOAD or measures.duration_s < LEAST_RUN_S or not placements:
        return
    if any(change.site == "cloud" or change.phase == "Cloud" for change in placements):
        return
    mistakes = [change for change in placements if change.reason in MISTAKES and not _aged(change)]
    if mistakes:
        message = mistakes[-1].message
        yield Violation(
            _since_start(measures, mistakes[-1].t_s),
            "Unused",
            f"The cloud never acted, because of the specification and not of the link: {message}.",
        )


def _aged(change: PlacementChange) -> bool:
    return change.reason == Reason.INPUT_STALE and "never arrived" not in change.message


def _handed(measures: Measures) -> Iterator[Violation]:
    recording = measures.recording
    held = [(interval.start_s, interval.end_s) for interval in inhibited(recording)]
    for t_s, kind, text in handed.broken(recording, gap_limit_ms(recording), held):
        yield Violation(_since_start(measures, t_s), kind, text)


def _switches_with_predecessor(recording: Recording) -> Iterator[tuple[PlacementChange, PlacementChange]]:
    placements = recording.placements
    for before, change in itertools.pairwise(placements):
        if before.site != change.site and change.t_s <= recording.end_s:
            yield change, before


def _since_start(measures: Measures, t_s: float) -> float:
    return t_s - measures.recording.run.start_s


def _messages(count: int) -> str:
    return f"{count} message" if count == 1 else f"{count} messages"


def _named(arrival: Arrival) -> str:
    return f"{arrival.producer}#{arrival.sequence}"
