"""The console's memory: a source's events in, the pages' content out. Pure: time comes with the events."""

from __future__ import annotations

import bisect
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

from robot_offload.console.live import NO_BOUNDS, NOTHING, UNKNOWN, Bounds, Changeover, Key, Live, Moment, Point
from robot_offload.console.reading import bounds
from robot_offload.insight.observed import Observed, observe

POINTS: Final = 6000
"""Twenty minutes of the strips at five points a second."""
MOMENTS: Final = 1200
"""The same twenty minutes of tables, at one a second."""
MOMENT_S: Final = 1.0
RATE_S: Final = 2.0
"""Rates of topics are averages over at least this many seconds."""
CHANGEOVERS: Final = 200
SAME_S: Final = 8.0
"""A reported and an observed changeover within this time are the same: a report counts for five seconds."""
SILENT_S: Final = 12.0
"""Live numbers older than this are shown as old."""


@dataclass(frozen=True, slots=True)
class Declared:
    """A RobotOffload as the source has it, in plain YAML values."""

    key: Key
    manifest: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Gone:
    """A RobotOffload no longer exists."""

    key: Key


@dataclass(frozen=True, slots=True)
class Said:
    """The agents' report at a moment."""

    key: Key
    t_s: float
    live: Live


@dataclass(frozen=True, slots=True)
class Switched:
    """A changeover that the source itself observed, or whose gap is now known (same moment: replaces)."""

    key: Key
    changeover: Changeover


@dataclass(frozen=True, slots=True)
class Trouble:
    """A robot, or (None) the source itself, cannot be read; empty: it can again."""

    key: Key | None
    problem: str


@dataclass(frozen=True, slots=True)
class Happened:
    """The newest Kubernetes events about a robot, as lines for people."""

    key: Key
    lines: tuple[str, ...]


Event = Declared | Gone | Said | Switched | Trouble | Happened


@dataclass
class Track:
    """Everything known about one robot.

    Attributes:
        key: which one.
        observed: as the API server has it; None: not yet, or it does not exist.
        bounds: the rule's numbers.
        live: the newest report.
        heard_s: when it came, on the source's clock; None: never.
        problem: why there are no live numbers; empty: there are.
        points, changeovers, moments: the past, oldest first.
        events: lines.
        version: grows with every change.
        rates: bytes and messages a second, by topic.
    """

    key: Key
    observed: Observed | None = None
    manifest: Mapping[str, Any] = field(default_factory=dict)
    bounds: Bounds = NO_BOUNDS
    live: Live = NOTHING
    heard_s: float | None = None
    problem: str = ""
    points: deque[Point] = field(default_factory=lambda: deque(maxlen=POINTS))
    changeovers: deque[Changeover] = field(default_factory=lambda: deque(maxlen=CHANGEOVERS))
    moments: deque[Moment] = field(default_factory=lambda: deque(maxlen=MOMENTS))
    events: tuple[str, ...] = ()
    version: int = 0

    @property
    def site(self) -> str:
        """The active side: as the agents report, else from the resource."""
        if self.heard_s is not None and not self.problem:
            return self.live.site
        return self.observed.placement.lower() if self.observed else UNKNOWN

    def window(self, from_s: float, to_s: float) -> list[Point]:
        """Return the points of a period."""
        first = bisect.bisect_left(self.points, from_s, key=lambda point: point.t_s)
        last = bisect.bisect_right(self.points, to_s, key=lambda point: point.t_s)
        return [self.points[index] for index in range(first, last)]

    def at(self, t_s: float) -> Live:
        """Return the report that held at a moment, or before them all the first one."""
        index = bisect.bisect_right(self.moments, t_s, key=lambda moment: moment.t_s)
        return self.moments[max(0, index - 1)].live if self.moments else self.live

    def rates(self, t_s: float) -> dict[str, tuple[float | None, float | None]]:
        """Return messages and bytes a second of each topic, over the last seconds before `t_s`."""
        index = bisect.bisect_right(self.moments, t_s, key=lambda moment: moment.t_s) - 1
        if index < 1:
            return {}
        new = self.moments[index]
        while index > 0 and self.moments[index].t_s > new.t_s - RATE_S:
            index -= 1
        old = self.moments[index]
        before = {topic.topic: topic for topic in old.live.topics}
        found = {}
        for topic in new.live.topics:
            past = before.get(topic.topic)
            if past is not None:
                passed_s = new.t_s - old.t_s
                found[topic.topic] = (
                    _rate(past.messages, topic.messages, passed_s),
                    _rate(past.size_bytes, topic.size_bytes, passed_s),
                )
        return found


@dataclass
class Fleet:
    """Every robot of a source.

    Attributes:
        source: what the page is about, for its title.
        recorded: whether it is a recording: it has ended, and times count from its start.
        problem: why the source cannot be read now; empty: it can.
        tracks: by key.
        version: grows with every change.
    """

    source: str
    recorded: bool = False
    problem: str = ""
    tracks: dict[Key, Track] = field(default_factory=dict)
    version: int = 0

    def take(self, event: Event) -> None:
        """Process an event."""
        self.version += 1
        if isinstance(event, Trouble) and event.key is None:
            self.problem = event.problem
            return
        assert event.key is not None
        if isinstance(event, Gone):
            self.tracks.pop(event.key, None)
            return
        track = self.tracks.setdefault(event.key, Track(event.key))
        track.version = self.version
        _take(track, event)

    def sorted(self) -> Sequence[Track]:
        """Return all robots in the order of their names."""
        return [self.tracks[key] for key in sorted(self.tracks)]


def _take(track: Track, event: Event) -> None:
    match event:
        case Declared():
            track.observed, track.manifest = observe(event.manifest), event.manifest
            track.bounds = bounds(track.observed.spec)
        case Said():
            _hear(track, event)
        case Switched():
            _switch(track, event.changeover)
        case Trouble():
            track.problem = event.problem
        case Happened():
            track.events = event.lines


def _hear(track: Track, said: Said) -> None:
    live, before = said.live, track.live
    if track.heard_s is not None and said.t_s < track.heard_s:
        return  # reordered: the newer report holds
    changed = track.heard_s is not None and live.site != before.site and UNKNOWN not in (live.site, before.site)
    track.live, track.heard_s, track.problem = live, said.t_s, ""
    track.points.append(Point(said.t_s, live.latency_ms, live.p99_ms, live.loss_share, live.site, live.cut))
    kept = track.moments
    if changed or not kept or said.t_s - kept[-1].t_s >= MOMENT_S:
        kept.append(Moment(said.t_s, live))
    if changed and not _known(track.changeovers, live.site, said.t_s):
        _switch(track, Changeover(said.t_s, live.site, live.reason, live.message))
    if live.last is not None:
        _learn(track, replace(live.last, t_s=said.t_s + live.last.t_s))


def _learn(track: Track, last: Changeover) -> None:
    """Merge the last changeover of a report: an observed one gets its gap, an unobserved one is added."""
    seen = track.changeovers[-1] if track.changeovers else None
    if seen is None or last.t_s > seen.t_s + SAME_S:
        track.changeovers.append(last)
    elif seen.to == last.to and abs(seen.t_s - last.t_s) <= SAME_S:
        track.changeovers[-1] = replace(seen, gap_ms=last.gap_ms)


def _known(changeovers: Iterable[Changeover], to: str, t_s: float) -> bool:
    """Return whether the source itself reported this change a moment before."""
    return any(each.to == to and abs(each.t_s - t_s) < MOMENT_S for each in changeovers)


def _switch(track: Track, changeover: Changeover) -> None:
    for index, each in enumerate(track.changeovers):
        if each.t_s == changeover.t_s and each.to == changeover.to:
            track.changeovers[index] = changeover
            return
    track.changeovers.append(changeover)


def _rate(before: int | None, now: int | None, passed_s: float) -> float | None:
    if before is None or now is None or passed_s <= 0 or now < before:
        return None
    return (now - before) / passed_s
