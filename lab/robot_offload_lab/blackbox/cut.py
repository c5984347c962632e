"""Cuts out a part of a black box that can be replayed alone: it begins with the key frames before its first step."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from robot_offload_core.record import blackbox
from robot_offload_core.record.blackbox import Gap, Header, KeyFrame, Record
from robot_offload_core.words.events import Machine
from robot_offload_lab.blackbox import ring


def cut(lines: Iterable[str], from_wall_s: float, to_wall_s: float) -> Iterator[str]:
    """Return the lines from the last key frames before `from_wall_s` on, up to `to_wall_s` (system time, seconds)."""
    before = _Before()
    offset_s, begun = 0.0, False
    for text in lines:
        record = blackbox.parse(text)
        if isinstance(record, Header):
            offset_s = ring.offset_s(record, offset_s)
        elif not isinstance(record, Gap):
            wall_s = record.now_s + offset_s
            if wall_s > to_wall_s:
                break
            if not begun and wall_s >= from_wall_s:
                begun = True
                yield from before.lines()
        if begun:
            yield text
        else:
            before.take(text, record)
    if not begun:
        yield from before.lines()


class _Before:
    """Lines to keep before the cut: nothing older than the newest key frames of all machines."""

    def __init__(self) -> None:
        self.header = ""  # of the file in which `kept` begins
        self.kept: list[tuple[str, bool]] = []  # (line, it is the first of a file)
        self.frames: dict[Machine, int] = {}

    def take(self, text: str, record: Record) -> None:
        if isinstance(record, KeyFrame):
            self.frames[record.machine] = len(self.kept)
            oldest = min(self.frames.values())
            self.header = next((line for line, first in reversed(self.kept[:oldest]) if first), self.header)
            self.kept = self.kept[oldest:]
            self.frames = {machine: at - oldest for machine, at in self.frames.items()}
        self.kept.append((text, isinstance(record, Header)))

    def lines(self) -> list[str]:
        first = [] if self.kept and self.kept[0][1] else [self.header]
        return [line for line in first if line] + [line for line, _ in self.kept]
