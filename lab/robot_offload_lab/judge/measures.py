"""Every figure of a run, from a recording made at the consumer. Pure; violations are defined in `invariants`.

Definitions beyond those of `streams`:

* switch: an announced placement whose side differs from the one before;
* gap of a switch: the longest gap of an output that touches the half second before and after the switch;
* lost and duplicates of a switch: those that arrived in the same window. Windows of switches that are less than a
  second apart overlap, so their sums can exceed the totals;
* good time: the link's loop latency is at most the threshold;
* detector alarm: the robot's `network_status` falls from 1 to 0; false when the link was good for the second before.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass

from robot_offload_lab.judge.recording import SITES, Arrival, LinkSample, PlacementChange, Recording, Site
from robot_offload_lab.judge.streams import Stream, examine, quantile

SWITCH_WINDOW_S = 0.5
"""Half the window around a switch in which its gap, losses and duplicates are counted."""
FALSE_ALARM_S = 1.0
"""A link that was good for this long gave no cause for an alarm."""


@dataclass(frozen=True)
class Interval:
    """A stretch of time."""

    start_s: float
    end_s: float

    @property
    def length_s(self) -> float:
        """Its length; 0 for an empty one."""
        return max(0.0, self.end_s - self.start_s)

    def overlap_s(self, other: Interval) -> float:
        """Return how long both last together."""
        return Interval(max(self.start_s, other.start_s), min(self.end_s, other.end_s)).length_s


@dataclass(frozen=True)
class Switch:
    """One change of the side in charge, and its effect on the consumers.

    Attributes:
        t_s: when it was announced (steady clock).
        before, after: the sides.
        change: the announcement.
        gap_ms: by topic; None where nothing arrived around it.
        lost: messages missing around it; None: not known (see Stream.known).
        duplicates: messages that passed twice around it; None: not known.
    """

    t_s: float
    before: Site
    after: Site
    change: PlacementChange
    gap_ms: Mapping[str, float | None]
    lost: int | None
    duplicates: int | None

    @property
    def commanded(self) -> bool:
        """Whether it was decided over a working link, not in answer to a loss."""
        return self.change.detect_ms is None


@dataclass(frozen=True)
class Measures:
    """All figures of one run.

    Attributes:
        streams: by topic.
        stays: who was in charge when, by the announcements.
        placement_share: of the time with a known placement; empty without one.
        good_s: how long the link was good.
        cloud_share_of_good_time: None when the link was never good or no placement is known.
        messages_passed: by side, of all outputs.
        alarms, false_alarms: of the robot's detector.
        outages: when the link was cut.
    """

    recording: Recording
    streams: Mapping[str, Stream]
    switches: tuple[Switch, ...]
    stays: tuple[tuple[Site, Interval], ...]
    placement_share: Mapping[Site, float]
    good_s: float
    cloud_share_of_good_time: float | None
    messages_passed: Mapping[Site, int]
    alarms: int
    false_alarms: int
    outages: tuple[Interval, ...]

    @property
    def duration_s(self) -> float:
        """How long the run lasted."""
        return self.recording.end_s - self.recording.run.start_s


def measure(recording: Recording) -> Measures:
    """Compute every figure of a run."""
    run, end_s = recording.run, recording.end_s
    departures = _departures(recording)
    streams = {
        topic: examine(topic, arrivals, end_s, run.max_command_age_ms, departures)
        for topic, arrivals in recording.outputs.items()
    }
    stays = tuple(_stays(recording))
    good = tuple(_link_intervals(recording, lambda sample: is_good(sample, run.threshold_ms)))
    good_s = sum(interval.length_s for interval in good)
    alarms = tuple(_alarms(recording))
    passed = [arrival.site for stream in streams.values() for arrival in stream.arrivals]
    return Measures(
        recording=recording,
        streams=streams,
        switches=tuple(_switches(recording, streams)),
        stays=stays,
        placement_share=_shares(stays),
        good_s=good_s,
        cloud_share_of_good_time=_cloud_share(stays, good) if good_s and stays else None,
        messages_passed={site: passed.count(site) for site in SITES},
        alarms=len(alarms),
        false_alarms=sum(link_was_good(recording, t_s - FALSE_ALARM_S, t_s) for t_s in alarms),
        outages=tuple(_link_intervals(recording, lambda sample: sample.rtt_ms is None)),
    )


def is_good(sample: LinkSample, threshold_ms: float) -> bool:
    """Return whether the link sustains the cloud at that moment."""
    return sample.rtt_ms is not None and sample.rtt_ms <= threshold_ms


def link_was_good(recording: Recording, start_s: float, end_s: float) -> bool:
    """Return whether no sample from `start_s` to `end_s` was bad; false when there is none."""
    samples = [sample for sample in recording.link if start_s <= sample.t_s <= end_s]
    return bool(samples) and all(is_good(sample, recording.run.threshold_ms) for sample in samples)


def median_period_ms(stream: Stream) -> float | None:
    """Return the median time between two messages of an output."""
    return quantile([gap.length_ms for gap in stream.gaps if gap.after is not None], 0.5)


def _switches(recording: Recording, streams: Mapping[str, Stream]) -> Iterator[Switch]:
    placements = [change for change in recording.placements if change.t_s <= recording.end_s]
    known = all(stream.known for stream in streams.values())
    for before, change in itertools.pairwise(placements):
        if before.site == change.site:
            continue
        window = Interval(change.t_s - SWITCH_WINDOW_S, change.t_s + SWITCH_WINDOW_S)
        yield Switch(
            t_s=change.t_s,
            before=before.site,
            after=change.site,
            change=change,
            gap_ms={topic: _gap_around(stream, window) for topic, stream in streams.items()},
            lost=sum(_lost_in(stream, window) for stream in streams.values()) if known else None,
            duplicates=sum(_count(stream.duplicates, window) for stream in streams.values()) if known else None,
        )


def _departures(recording: Recording) -> dict[Site, list[float]]:
    """Return for each side when the other side was announced to be in charge."""
    found: dict[Site, list[float]] = {site: [] for site in SITES}
    for before, change in itertools.pairwise(recording.placements):
        if before.site != change.site:
            found[before.site].append(change.t_s)
    return found


def _gap_around(stream: Stream, window: Interval) -> float | None:
    lengths = [gap.length_ms for gap in stream.gaps if Interval(gap.start_s, gap.end_s).overlap_s(window) > 0]
    return max(lengths, default=None)


def _lost_in(stream: Stream, window: Interval) -> int:
    return sum(hole.count for hole in stream.holes if window.start_s <= hole.t_s <= window.end_s)


def _count(arrivals: Iterable[Arrival], window: Interval) -> int:
    return sum(window.start_s <= arrival.t_s <= window.end_s for arrival in arrivals)


def _stays(recording: Recording) -> Iterator[tuple[Site, Interval]]:
    """Yield each side's stays in charge, from the first announcement to the end; adjacent ones are joined."""
    changes = [change for change in recording.placements if change.t_s <= recording.end_s]
    start_s, end_s = recording.run.start_s, recording.end_s
    site: Site | None = None
    since_s = start_s
    for change in changes:
        if change.site == site:
            continue
        if site is not None and change.t_s > since_s:
            yield site, Interval(since_s, change.t_s)
        site, since_s = change.site, max(start_s, change.t_s)
    if site is not None and end_s > since_s:
        yield site, Interval(since_s, end_s)


def _shares(stays: Iterable[tuple[Site, Interval]]) -> dict[Site, float]:
    times = dict.fromkeys(SITES, 0.0)
    for site, interval in stays:
        times[site] += interval.length_s
    total = sum(times.values())
    return {site: time / total for site, time in times.items()} if total else {}


def _cloud_share(stays: Iterable[tuple[Site, Interval]], good: tuple[Interval, ...]) -> float | None:
    """Return the share of the good time, as far as the placement is known, in which the cloud was in charge."""
    times = dict.fromkeys(SITES, 0.0)
    for site, stay in stays:
        times[site] += sum(stay.overlap_s(interval) for interval in good)
    total = sum(times.values())
    return times["cloud"] / total if total else None


def _link_intervals(recording: Recording, chosen: Callable[[LinkSample], bool]) -> Iterator[Interval]:
    """Yield the stretches of chosen link samples. A sample holds until the next one."""
    start_s: float | None = None
    for sample in recording.link:
        if sample.t_s >= recording.end_s:
            break
        if chosen(sample) and start_s is None:
            start_s = max(sample.t_s, recording.run.start_s)
        elif not chosen(sample) and start_s is not None:
            yield Interval(start_s, sample.t_s)
            start_s = None
    if start_s is not None:
        yield Interval(start_s, recording.end_s)


def _alarms(recording: Recording) -> Iterator[float]:
    """Yield when the robot's own verdict fell from good to bad."""
    up = False
    for status in recording.network_status:
        if status.side != "robot" or status.t_s > recording.end_s:
            continue
        if up and not status.up:
            yield status.t_s
        up = status.up
