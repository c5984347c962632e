"""What must hold in every run, judged from a recording made at the consumer. Pure.

These are the promises of the switching protocol as far as a consumer can see them. Collisions and the goal are
reported beside them: they depend on the application too. Each violation is a sentence with its time and figures.

* `Duplicate`: no message passes twice.
* `Reordered`: the messages of one replica pass in their order.
* `Interleaved`: a side that is not in charge is not heard. Two things are allowed: the old side passes until the
  first message of the new side (make before break), and an announcement may lag behind the collector.
* `Stale`: nothing from the cloud passes that is older than maxCommandAge. What the robot's own replica publishes never
  crosses the link; its delays are counted in the report, and a long one is a `Gap`.
* `Gap`: no silence is longer than lossTimeout + activationDeadline + the slower period + 200 ms, not counting the
  time in which the driver was inhibited (then the robot stands and nothing may be expected). Outputs without a rate
  or with a condition (`while`) are not judged: the feedback of the goals is.
* `Lost`: a commanded switch over a good link loses nothing from the cloud (what the robot's own replica loses on the
  robot is counted in the report). Not judged when the switch was commanded because the agents found the loop too slow:
  a busy computer delays like a bad link, and what is too old must not pass.
* `Unused`: the cloud acts at some time unless the link forbids that. An input that nobody publishes, another type, or
  a replica that does not get ready are mistakes of the specification, and the sentence of the agent names the culprit.
* `Epoch`: every change of the side in charge has a higher epoch.

What is promised about goals, calls and state stands in `handed`.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from robot_offload_core.reasons import Reason
from robot_offload_lab.judge import handed
from robot_offload_lab.judge.measures import SWITCH_WINDOW_S, Interval, Measures, link_was_good
from robot_offload_lab.judge.recording import Arrival, PlacementChange, Recording
from robot_offload_lab.judge.streams import Gap, Stream

OFFLOAD = "offload"
"""The mode in which the agents may use both sides."""
GAP_MARGIN_MS = 200.0
"""For what a busy computer adds to the sum of the declared times: scheduling, the middleware, the recorder itself."""
ANNOUNCEMENT_LAG_S = 0.3
"""How late the announcement of a placement may be against the messages that pass the collector: a lease (250 ms by
default), because control that is silent for longer makes the collector pass the robot only, and its way to us."""


MISTAKES = frozenset({
    Reason.INPUT_STALE, Reason.INPUTS_DIFFER, Reason.CLOUD_NOT_READY, Reason.TYPES_DIFFER, Reason.SECOND_PUBLISHER,
    Reason.UNDECLARED_PUBLISHER, Reason.SECOND_LIFECYCLE_MANAGER, Reason.REPLICA_PARAMETERS_DIFFER,
})  # fmt: skip
"""Reasons against the cloud that no link explains."""
LEAST_RUN_S = 10.0
"""A shorter run proves nothing about what is never used."""


@dataclass(frozen=True)
class Violation:
    """One broken promise.

    Attributes:
        t_s: when, counted from the start of the run.
        kind: one word, see the module.
        text: a sentence with time and figures.
    """

    t_s: float
    kind: str
    text: str


def violations(measures: Measures) -> tuple[Violation, ...]:
    """Returns every broken promise of a run, in the order of time."""
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
    """Returns the longest silence of an output that the run's settings explain."""
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
    """Yields one violation per stay in which the other side was heard after the new one."""
    placements = measures.recording.placements
    heard: dict[int, list[Arrival]] = {}
    started: set[int] = set()
    index = -1
    for arrival in stream.arrivals:
        while index + 1 < len(placements) and placements[index + 1].t_s <= arrival.t_s:
            index += 1
        stay = _stay(placements, index)
        if stay is None:
            continue
        if arrival.site == placements[stay].site:
            started.add(stay)
        elif _announced_soon(stream, placements[index + 1 :], arrival):
            continue
        elif stay in started or _started_before(stream, placements[stay]):
            heard.setdefault(stay, []).append(arrival)
    for stay, arrivals in heard.items():
        first, site = arrivals[0], placements[stay].site
        t_s = _since_start(measures, first.t_s)
        yield Violation(
            t_s,
            "Interleaved",
            f"{_messages(len(arrivals))} of {stream.topic} from the {first.site} passed after the {site} had taken "
            f"over (epoch {placements[stay].epoch}), the first, {_named(first)}, at {t_s:.3f} s.",
        )


def _stay(placements: Sequence[PlacementChange], index: int) -> int | None:
    """Returns the announcement with which the present stay began (later ones may only repeat the side)."""
    if index < 0:
        return None
    while index > 0 and placements[index - 1].site == placements[index].site:
        index -= 1
    return index


def _announced_soon(stream: Stream, later: Sequence[PlacementChange], arrival: Arrival) -> bool:
    """Returns whether the side of `arrival` is announced a moment later, and only that side is heard until then."""
    limit_s = arrival.t_s + ANNOUNCEMENT_LAG_S
    announced_s = next((change.t_s for change in later if change.site == arrival.site and change.t_s <= limit_s), None)
    if announced_s is None:
        return False
    return all(other.site == arrival.site for other in stream.arrivals if arrival.t_s < other.t_s < announced_s)


def _started_before(stream: Stream, change: PlacementChange) -> bool:
    """Returns whether the new side's first message passed shortly before its announcement."""
    return any(
        arrival.site == change.site and change.t_s - ANNOUNCEMENT_LAG_S <= arrival.t_s < change.t_s
        for arrival in stream.arrivals
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
    """Returns when the driver held the wheels because no core node was able to steer."""
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
    """Returns the longest part of a gap in which the driver was not inhibited."""
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
    """Yields what kept the cloud out for the whole run when that is a mistake of the specification.

    An input that was heard for a while and grew old on the way is a matter of the link.
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
