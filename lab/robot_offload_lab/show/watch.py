"""What is known of a run while it goes on, from the recorder's live stream; none of it goes into the report.

`LiveRun` takes the stream's lines and reports what happened, a sentence each. The views only draw it.
"""

from __future__ import annotations

import itertools
import json
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Final

from robot_offload_lab.judge.recording import (
    LINES,
    Arrival,
    Calls,
    Errand,
    Inhibit,
    LinkSample,
    PlacementChange,
    Restored,
    Site,
)

GAP_WINDOW_S: Final = 0.5
"""Half the window around a switch in which its silence is measured, as in the report."""
_KEPT: Final = 200
"""Arrivals kept for each output: a second and a half at 125 Hz."""


@dataclass
class SwitchSeen:
    """A change of the side in charge.

    Attributes:
        t_s: steady clock.
        detect_ms: from the last good heartbeat to the decision; None when it was commanded.
        gap_ms: the longest silence of any output around it; None while it is not known.
    """

    t_s: float
    to: Site
    reason: str
    detect_ms: float | None
    gap_ms: float | None = None


@dataclass(frozen=True)
class Event:
    """Something that happened, for people. `t_s` is the steady clock."""

    t_s: float
    text: str


@dataclass
class LiveRun:
    """The present state of a run.

    Attributes:
        threshold_ms: loop latency up to which the link is good.
        outputs: the topics that must be heard.
        unrated: topics whose silence means nothing.
        start_s: the moment that the report calls 0; None before the start.
        link: the schedule of the link now; None without one.
        placement: the newest announcement.
        charged_s: since when that side has been in charge.
        drive: the application's account of its drive as the recorder prints it, empty without one.
        round_trip_ms: measured by the agents; None while they have not met.
        nodes: lifecycle states of the robot's nodes, as its agent sees them.
        received: messages by topic.
        ages_ms: age of the newest message by topic.
        switches: since the start.
        goals: the newest report about each goal, by its number.
        calls: the newest report about service calls; None without any.
        restored: the state with which each node last began, by its name.
    """

    threshold_ms: float
    outputs: tuple[str, ...] = ()
    unrated: tuple[str, ...] = ()
    start_s: float | None = None
    link: LinkSample | None = None
    placement: PlacementChange | None = None
    charged_s: float = 0.0
    drive: dict[str, Any] = field(default_factory=dict)
    round_trip_ms: float | None = None
    nodes: dict[str, str] = field(default_factory=dict)
    received: dict[str, int] = field(default_factory=dict)
    ages_ms: dict[str, float] = field(default_factory=dict)
    switches: list[SwitchSeen] = field(default_factory=list)
    goals: dict[int, Errand] = field(default_factory=dict)
    calls: Calls | None = None
    restored: dict[str, Restored] = field(default_factory=dict)
    _times: dict[str, deque[float]] = field(default_factory=dict)
    _events: list[Event] = field(default_factory=list)
    _link_word: str = ""

    def take(self, line: str) -> None:
        """Take one line of the recorder's stream; unreadable lines are ignored."""
        try:
            message = json.loads(line)
            if "drive" in message:
                self._take_drive(message["drive"])
            elif "agents" in message:
                self._take_agents(message["agents"])
            else:
                self.take_record(LINES.decode(line))
        except (ValueError, KeyError, TypeError):
            return

    def attend(self, now_s: float) -> None:
        """Let time pass, after which the silence around the last switches may be known."""
        for switch in self.switches:
            end_s = switch.t_s + GAP_WINDOW_S
            # A silence that still lasts has no length yet.
            closed = all(times[-1] >= end_s for times in self._times.values())
            if switch.gap_ms is None and closed:
                switch.gap_ms = max((self._gap_ms(topic, switch.t_s) for topic in self._times), default=0.0)
                text = f"longest silence around the switch at {self.since_start(switch.t_s):.1f} s"
                self._events.append(Event(now_s, f"{text}: {switch.gap_ms:.0f} ms"))

    def events(self) -> tuple[Event, ...]:
        """Return what has happened since the last call."""
        events, self._events = tuple(self._events), []
        return events

    def since_start(self, t_s: float) -> float:
        """Return the seconds from the start to a moment; 0 before the start."""
        return 0.0 if self.start_s is None else t_s - self.start_s

    @property
    def goal_reached(self) -> bool:
        """Whether there is a goal and the robot has reached it."""
        return bool(self.drive.get("goal_reached"))

    @property
    def under_way(self) -> bool:
        """Whether a client still waits for the result of a goal."""
        return any(not goal.ending for goal in self.goals.values())

    def missing(self) -> tuple[str, ...]:
        """Return the outputs that have not been heard yet."""
        return tuple(topic for topic in self.outputs if not self.received.get(topic))

    def link_word(self) -> str:
        """Return the state of the link: `cut`, `slow` or `good`; empty without one."""
        if self.link is None:
            return ""
        if self.link.rtt_ms is None:
            return "cut"
        return "good" if self.link.rtt_ms <= self.threshold_ms else "slow"

    def _take_drive(self, drive: dict[str, Any]) -> None:
        if drive["goal_reached"] and not self.goal_reached:
            self._events.append(Event(drive["t_s"], "the goal is reached"))
        if self.drive and drive["collisions"] > self.drive["collisions"]:
            self._events.append(Event(drive["t_s"], "the robot collided"))
        self.drive = drive

    def _take_agents(self, agents: dict[str, Any]) -> None:
        self.round_trip_ms = float(agents["round_trip_p50_ms"]) if agents["round_trip_p50_ms"] else None
        self.nodes = agents["nodes"]

    def take_record(self, record: object) -> None:
        """Take one record of a recording."""
        if isinstance(record, Arrival):
            self.ages_ms[record.topic] = record.age_s * 1e3
            self.received[record.topic] = self.received.get(record.topic, 0) + 1
            if record.topic not in self.unrated:
                self._times.setdefault(record.topic, deque(maxlen=_KEPT)).append(record.t_s)
        elif isinstance(record, PlacementChange):
            self._take_placement(record)
        elif isinstance(record, Errand):
            self._take_goal(record)
        elif isinstance(record, Calls):
            self.calls = record
        elif isinstance(record, Restored):
            self.restored[record.node] = record
        elif isinstance(record, LinkSample):
            self.link = record
            self._tell_link(record)
        elif isinstance(record, Inhibit):
            text = "the driver is inhibited: no core node is able to steer" if record.inhibited else "driver released"
            self._events.append(Event(record.t_s, text))

    def _take_goal(self, goal: Errand) -> None:
        before = self.goals.get(goal.goal)
        self.goals[goal.goal] = goal
        if goal.accepted_ms is not None and (before is None or before.accepted_ms is None):
            self._events.append(Event(goal.t_s, f"goal {goal.goal} is accepted after {goal.accepted_ms:.1f} ms"))
        if before is not None and goal.servers > max(1, before.servers):
            self._events.append(Event(goal.t_s, f"goal {goal.goal} goes on with another replica"))
        if goal.ending and not (before is not None and before.ending):
            self._events.append(Event(goal.t_s, f"goal {goal.goal}: {goal.ending}"))

    def _take_placement(self, change: PlacementChange) -> None:
        before, self.placement = self.placement, change
        switched = before is not None and before.site != change.site
        if before is None or switched:
            self.charged_s = change.t_s
        if switched:
            if self.start_s is not None:
                self.switches.append(SwitchSeen(change.t_s, change.site, change.reason, change.detect_ms))
            lost = "" if change.detect_ms is None else f", {change.detect_ms:.0f} ms after the last good heartbeat"
            self._events.append(
                Event(change.t_s, f"the {change.site} takes over: {change.reason} ({change.message}){lost}")
            )
        elif before is None or before.reason != change.reason:
            self._events.append(Event(change.t_s, f"the {change.site} acts: {change.reason} ({change.message})"))

    def _tell_link(self, sample: LinkSample) -> None:
        word = self.link_word()
        if word != self._link_word:
            latency = "" if sample.rtt_ms is None else f", {sample.rtt_ms:.0f} ms"
            self._events.append(Event(sample.t_s, f"the link is {word}{latency}"))
        self._link_word = word

    def _gap_ms(self, topic: str, around_s: float) -> float:
        """Return the longest silence of an output that touches the window around a moment."""
        return max(self._gaps_ms(topic, around_s - GAP_WINDOW_S, around_s + GAP_WINDOW_S), default=0.0)

    def _gaps_ms(self, topic: str, from_s: float, to_s: float) -> Iterator[float]:
        times = list(self._times[topic])
        for before_s, after_s in itertools.pairwise(times):
            if before_s < to_s and after_s > from_s:
                yield (after_s - before_s) * 1e3
