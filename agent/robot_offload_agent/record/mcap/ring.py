"""The last seconds of received messages, in memory, and the windows around changeovers that are cut out of them. Pure.

Bounded in time and in bytes: the oldest messages are dropped for lack of room, and a window states if it lacks some.
Of latched topics the newest older message is kept as well: what holds at the beginning of a window belongs to it.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

OVERHEAD_BYTES = 200
"""Of an entry besides its data, so that many small ones are bounded, too."""
SLACK_S = 5.0
"""A window may be requested this long after its end, because a busy machine is late."""
MAX_WINDOWS = 8
"""Changeovers whose windows are open at once; a robot that switches more often has worse problems than recordings."""


@dataclass(frozen=True)
class Entry:
    """A message as received.

    Attributes:
        at_s: when, on the steady clock.
        stamp_ns: the same on the system clock.
        topic: name of its topic.
        type_name: its type.
        latched: the newest one holds until the next one.
        data: serialized.
    """

    at_s: float
    stamp_ns: int
    topic: str
    type_name: str
    data: bytes
    latched: bool = False

    @property
    def size(self) -> int:
        """Bytes of memory, about."""
        return len(self.data) + OVERHEAD_BYTES


@dataclass(frozen=True)
class Changeover:
    """A change of who is in charge: when it was received, the new side, the reason."""

    at_s: float
    stamp_ns: int
    site: str
    epoch: int
    reason: str


@dataclass(frozen=True)
class Window:
    """The part of a recording for one changeover.

    Attributes:
        entries: in order of arrival; the first are what held at the beginning.
        cut: older ones were dropped for lack of room.
    """

    changeover: Changeover
    entries: tuple[Entry, ...]
    cut: bool


class Ring:
    """The ring of messages. Times are of the steady clock, seconds.

    Args:
        before_s, after_s: how much of the time around a changeover is kept.
        max_bytes: of memory.

    Attributes:
        left_out: changeovers for which no window was free, and messages that are larger than the ring.
    """

    def __init__(self, before_s: float, after_s: float, max_bytes: int) -> None:
        self.before_s, self.after_s, self.max_bytes = before_s, after_s, max_bytes
        self.left_out = 0
        self._entries: deque[Entry] = deque()
        self._bytes = 0
        self._held: dict[str, Entry] = {}
        self._cut_s = float("-inf")
        self._open: list[Changeover] = []

    def add(self, entry: Entry) -> None:
        """Take a message; drop those that are too old, or too many."""
        if entry.size > self.max_bytes:
            self.left_out += 1
            self._cut_s = entry.at_s
            return
        self._entries.append(entry)
        self._bytes += entry.size
        oldest_s = entry.at_s - self.before_s - self.after_s - SLACK_S
        while self._entries[0].at_s < oldest_s:
            self._drop()
        while self._bytes > self.max_bytes:
            self._cut_s = self._entries[0].at_s
            self._drop()

    def begin(self, changeover: Changeover) -> bool:
        """Open a window; return False if too many are open."""
        if len(self._open) >= MAX_WINDOWS:
            self.left_out += 1
            return False
        self._open.append(changeover)
        return True

    def due(self, now_s: float) -> list[Window]:
        """Return the windows whose time is over; with `now_s` infinite all that are open."""
        over = [each for each in self._open if now_s >= each.at_s + self.after_s]
        self._open = [each for each in self._open if each not in over]
        return [self._window(each) for each in over]

    def _window(self, changeover: Changeover) -> Window:
        begin_s, end_s = changeover.at_s - self.before_s, changeover.at_s + self.after_s
        held, inside = dict(self._held), []
        for entry in self._entries:
            if entry.at_s < begin_s:
                if entry.latched:
                    held[entry.topic] = entry
            elif entry.at_s <= end_s:
                inside.append(entry)
        first_ns = inside[0].stamp_ns if inside else changeover.stamp_ns
        begun = [replace(entry, stamp_ns=first_ns) for entry in held.values()]
        return Window(changeover, (*begun, *inside), self._cut_s >= begin_s)

    def _drop(self) -> None:
        entry = self._entries.popleft()
        self._bytes -= entry.size
        if entry.latched:
            self._held[entry.topic] = entry
