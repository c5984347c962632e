"""The emulated link as a whole: schedule, overrides, the models of both directions and their counters. Pure."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from robot_offload_lab.wire.model import CLEAR, DirectionModel, LinkConditions, StreamModel, WireError
from robot_offload_lab.wire.schedule import Pair, Schedule

Direction = Literal["up", "down"]
"""`up` is from the robot to the cloud."""

_DIRECTIONS: tuple[Direction, Direction] = ("up", "down")
_CUTS: dict[str | None, tuple[Direction, ...]] = {
    "up": ("up",),
    "down": ("down",),
    "both": _DIRECTIONS,
    None: (),
}
_FIELDS = {field.name: type(field.default) for field in dataclasses.fields(LinkConditions) if field.name != "cut"}


class ControlError(WireError):
    """A control message that cannot be obeyed; nothing was changed."""


@dataclass
class Counters:
    """What has happened in one direction since the start of the process.

    Attributes:
        datagrams: datagrams offered to the link.
        dropped: datagrams lost by a cut, by chance or by the full queue.
        stream_bytes: bytes offered by TCP connections.
        retransmissions: those of TCP streams, failed ones included.
        errors: send or receive errors of a socket, such as a refused connection because the cloud is absent.
    """

    datagrams: int = 0
    dropped: int = 0
    stream_bytes: int = 0
    retransmissions: int = 0
    errors: int = 0


class EmulatedLink:
    """One link with two directions, shared by all ports of a wire.

    Conditions are those of the schedule (before its start: the quiet ones) with overrides on top.
    """

    def __init__(self, schedule: Schedule, seed: int) -> None:
        self._schedule = schedule
        self._started_s: float | None = None
        self._overrides: dict[Direction, dict[str, Any]] = {"up": {}, "down": {}}
        self._cuts: tuple[Direction, ...] = ()
        self._models = {direction: DirectionModel(seed, direction) for direction in _DIRECTIONS}
        self.counters = {direction: Counters() for direction in _DIRECTIONS}

    @property
    def started_s(self) -> float | None:
        """When the schedule's clock was started; None before."""
        return self._started_s

    def start(self, now_s: float) -> None:
        """Start the schedule's clock at 0; restart it if it runs already."""
        self._started_s = now_s

    def follow(self, schedule: Schedule) -> None:
        """Replace the schedule; the link is quiet until `start`. Packets under way, queue and random draws stay."""
        self._schedule, self._started_s = schedule, None

    def conditions(self, now_s: float) -> Pair:
        """Return the conditions of this moment, up and down."""
        if self._started_s is None:
            up, down = self._schedule.quiet()
        else:
            up, down = self._schedule.at(now_s - self._started_s)
        return self._overridden("up", up), self._overridden("down", down)

    def next_change_s(self, now_s: float) -> float | None:
        """Return when the next outage or slow phase begins or ends; None without any."""
        if self._started_s is None:
            return None
        change_s = self._schedule.next_change_s(now_s - self._started_s)
        return None if change_s is None else change_s + self._started_s

    def datagram(self, direction: Direction, now_s: float, size: int) -> float | None:
        """Offer a datagram; return when it arrives, None when it is lost."""
        here = self.conditions(now_s)[_DIRECTIONS.index(direction)]
        arrives_s = self._models[direction].datagram(now_s, size, here)
        counters = self.counters[direction]
        counters.datagrams += 1
        counters.dropped += arrives_s is None
        return arrives_s

    def stream(self, direction: Direction) -> StreamModel:
        """Return the model of one direction of a new TCP connection."""
        return StreamModel(self._models[direction])

    def offer(self, direction: Direction, stream: StreamModel, now_s: float, size: int) -> float | None:
        """Offer bytes of a stream; see `StreamModel.offer`."""
        self.counters[direction].stream_bytes += size
        pair = self.conditions(now_s)
        round_trip_s = (pair[0].delay_ms + pair[1].delay_ms) / 1000
        return stream.offer(now_s, size, pair[_DIRECTIONS.index(direction)], round_trip_s)

    def retry(self, direction: Direction, stream: StreamModel, now_s: float, size: int) -> float | None:
        """Retransmit what a stream holds; see `StreamModel.retry`."""
        self.counters[direction].retransmissions += 1
        return stream.retry(now_s, size, self.conditions(now_s)[_DIRECTIONS.index(direction)])

    def room(self, direction: Direction, now_s: float) -> tuple[int, float]:
        """Return how much a stream may put on the link now without filling the queue for others.

        Returns:
            Bytes, and, when 0, how long to wait, in seconds.
        """
        here = self.conditions(now_s)[_DIRECTIONS.index(direction)]
        if not here.rate_kbit_s or not here.queue_ms:
            return 1 << 16, 0.0
        spare_s = here.queue_ms / 1000 - self._models[direction].backlog_s(now_s)
        if spare_s <= 0:
            return 0, -spare_s + here.queue_ms / 4000
        return min(1 << 16, max(1, int(spare_s / 2 * here.rate_kbit_s * 125))), 0.0

    def override(self, changes: Mapping[str, Any]) -> None:
        """Put conditions on top of the schedule's, at once.

        `{"delay_ms": 80, "loss": 0.03}` replaces these values in both directions, `{"up": {"loss": 0.1}}` in one;
        None returns a value to the schedule. `{"cut": "up" | "down" | "both" | None}` states which directions
        are cut regardless of the schedule.

        Raises:
            ControlError: an unknown name or a value out of range; nothing was changed.
        """
        overrides = {direction: dict(values) for direction, values in self._overrides.items()}
        cuts = self._cuts
        for name, value in changes.items():
            if name == "cut":
                if not isinstance(value, str | None) or value not in _CUTS:
                    raise ControlError(f"cut must be up, down, both or null, found {value!r}")
                cuts = _CUTS[value]
            elif name in ("up", "down"):
                if not isinstance(value, Mapping):
                    raise ControlError(f"{name} must be an object of conditions, found {value!r}")
                _change(overrides["up" if name == "up" else "down"], value)
            else:
                for values in overrides.values():
                    _change(values, {name: value})
        self._overrides, self._cuts = overrides, cuts

    def _overridden(self, direction: Direction, here: LinkConditions) -> LinkConditions:
        values = self._overrides[direction]
        cut = here.cut or direction in self._cuts
        if not values and cut == here.cut:
            return here
        return dataclasses.replace(here, **values, cut=cut)


def _change(overrides: dict[str, Any], values: Mapping[str, Any]) -> None:
    for name, value in values.items():
        if name not in _FIELDS:
            raise ControlError(f"unknown condition {name!r}; known are {', '.join(sorted(_FIELDS))} and cut")
        if value is None:
            overrides.pop(name, None)
            continue
        wanted = _FIELDS[name]
        if isinstance(value, bool) != (wanted is bool) or not isinstance(value, bool | int | float):
            raise ControlError(f"{name} must be a {'truth value' if wanted is bool else 'number'}, found {value!r}")
        overrides[name] = value
    dataclasses.replace(CLEAR, **overrides)  # refuses what is out of range
