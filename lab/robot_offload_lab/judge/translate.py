"""From what a consumer receives in ROS to the records of a run. Pure: no ROS, no clock.

Messages name their producer. A stamped one carries `PRODUCER#SEQUENCE` in `header.frame_id` and its production time in
`header.stamp`; a text reads `hello SEQUENCE from PRODUCER`. Of other messages only the times of arrival can be judged.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from robot_offload.api.v1alpha1.name_rules import REMOTE_PREFIX
from robot_offload_lab.judge.recording import Arrival, Inhibit, LinkSample, Obstacle, PathPoint, PlacementChange, Site
from robot_offload_lab.wire.schedule import Schedule

LINK_SAMPLE_S: Final = 0.05
"""Interval at which the link's schedule is recorded, besides the beginnings and ends of its phases."""
_EDGE_S: Final = 1e-6
"""This long after an edge it is clear which phase holds."""
_STAMPED: Final = re.compile(r"(?P<producer>[A-Za-z_][A-Za-z0-9_]*)#(?P<sequence>\d{1,15})")
_TEXT: Final = re.compile(r"hello (?P<sequence>\d{1,15}) from (?P<producer>[A-Za-z_][A-Za-z0-9_]*)")


@dataclass
class Arrivals:
    """Makes arrivals of one output and remembers what is needed to distinguish repeated messages from a restart.

    Attributes:
        topic: the public topic.
        acting: the side that is announced to be in charge; the site of messages that do not name theirs.
        unknown: number of messages without an identity so far.
    """

    topic: str
    acting: Site = "robot"
    unknown: int = 0
    _highest: dict[str, tuple[int, float]] = field(default_factory=dict)
    _last_s: float = -math.inf

    def delivered_s(self, received_s: float) -> float:
        """Return when a message received then was delivered.

        A reliable reader hands messages over in the writer's order. A message that was lost and sent again is received
        after its successors, which wait for it: they are delivered with it, not before it.
        """
        self._last_s = max(self._last_s, received_s)
        return self._last_s

    def stamped(self, t_s: float, frame_id: str, made_s: float, passed_s: float | None = None) -> Arrival:
        """Return a message with a header; `made_s` is its stamp, `passed_s` its publication, on the clock of `t_s`."""
        match = _STAMPED.fullmatch(frame_id)
        if match is None:
            return self.other(t_s)
        producer, sequence = match["producer"], int(match["sequence"])
        return Arrival(self.topic, t_s, producer, sequence, made_s, site_of(producer), passed_s)

    def text(self, t_s: float, text: str) -> Arrival:
        """Return a text. It carries no production time: it counts as made when it was first received.

        Without a time a repeated message and a restarted producer differ only in how far the count falls back: to less
        than half is taken for a restart.
        """
        match = _TEXT.fullmatch(text)
        if match is None:
            return self.other(t_s)
        producer, sequence = match["producer"], int(match["sequence"])
        highest, made_s = self._highest.get(producer, (-1, t_s))
        if sequence > highest or sequence < highest / 2:
            self._highest[producer] = (sequence, t_s)
            made_s = t_s
        return Arrival(self.topic, t_s, producer, sequence, made_s, site_of(producer))

    def other(self, t_s: float) -> Arrival:
        """Return a message that does not name its producer."""
        self.unknown += 1
        return Arrival(self.topic, t_s, self.acting, self.unknown, t_s, self.acting, named=False)


def site_of(producer: str) -> Site:
    """Return the side of a replica: those in the cloud are called remote_NAME."""
    return "cloud" if producer.startswith(REMOTE_PREFIX) else "robot"


def placement(t_s: float, text: str) -> PlacementChange | None:
    """Read an announcement on /offload/placement; return None when it cannot be read."""
    try:
        said = json.loads(text)
        silent_ms, since_s = said["silent_ms"], said.get("since_s")
        return PlacementChange(
            t_s=t_s,
            site={"robot": "robot", "cloud": "cloud"}[said["site"]],  # type: ignore[arg-type]  # only these two
            epoch=int(said["epoch"]),
            reason=str(said["reason"]),
            message=str(said["message"]),
            detect_ms=None if silent_ms is None else float(silent_ms),
            phase=str(said.get("phase", "")),
            since_s=None if since_s is None else float(since_s),
            control=str(said.get("control", "")),
        )
    except (ValueError, KeyError, TypeError, AttributeError):
        return None


@dataclass(frozen=True)
class Drive:
    """The application's own account of its drive at one moment (std_msgs/String with JSON).

    Attributes:
        t_s: when it was heard.
        inhibited: the driver holds the wheels.
        stops: forced standstills.
        collisions: with walls and obstacles; like stops, so far.
        obstacles: seen so far.
        walls: x and y of both ends of each, where there is more than a corridor.
    """

    t_s: float
    x_m: float
    y_m: float
    speed_mps: float
    length_m: float
    width_m: float
    goal_x_m: float
    collisions: int
    stops: int
    inhibited: bool
    goal_reached: bool
    obstacles: tuple[Obstacle, ...]
    walls: tuple[tuple[float, float, float, float], ...] = ()

    def records(self, before: Drive | None) -> Iterator[PathPoint | Obstacle | Inhibit]:
        """Yield what is new since the account before."""
        yield PathPoint(self.t_s, self.x_m, self.y_m, self.speed_mps)
        for obstacle in self.obstacles:
            if before is None or obstacle not in before.obstacles:
                yield obstacle
        if self.inhibited != (before is not None and before.inhibited):
            yield Inhibit(self.t_s, self.inhibited)


def drive(t_s: float, text: str) -> Drive | None:
    """Return the account as published; None when the text is not one."""
    try:
        said: Mapping[str, Any] = json.loads(text)
        corridor = said["corridor"]
        return Drive(
            t_s=t_s,
            x_m=float(said["x"]),
            y_m=float(said["y"]),
            speed_mps=float(said["speed"]),
            length_m=float(corridor["length"]),
            width_m=float(corridor["width"]),
            goal_x_m=float(said["goal"][0]),
            collisions=int(said["collisions"]),
            stops=int(said["stops"]),
            inhibited=bool(said["inhibited"]),
            goal_reached=bool(said["goal_reached"]),
            obstacles=tuple(Obstacle(float(x), float(y), float(radius)) for x, y, radius in said["obstacles"]),
            walls=tuple((float(a), float(b), float(c), float(d)) for a, b, c, d in said.get("walls", ())),
        )
    except (ValueError, KeyError, TypeError, IndexError):
        return None


def link_samples(schedule: Schedule, start_s: float, from_s: float, to_s: float) -> Iterator[LinkSample]:
    """Yield what the schedule does from `from_s` up to, not including, `to_s`, in the order of time.

    Args:
        schedule: of the emulated link.
        start_s: steady time of the schedule's 0.
        from_s: steady time, not before `start_s`.
        to_s: steady time.
    """
    number = math.ceil((from_s - start_s) / LINK_SAMPLE_S - 1e-9)
    while (moment_s := start_s + number * LINK_SAMPLE_S) < to_s:
        yield LinkSample(moment_s, schedule.latency_ms(moment_s - start_s))
        number += 1
        edge_s = schedule.next_change_s(moment_s - start_s)
        if edge_s is not None and edge_s < number * LINK_SAMPLE_S:
            yield LinkSample(start_s + edge_s, schedule.latency_ms(edge_s + _EDGE_S))
