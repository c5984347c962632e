"""A small buffer of transforms, as tf2 keeps one: by child frame and stamp, with lookups between two stamps."""

from __future__ import annotations

from bisect import bisect_left, insort
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

KEPT_S = 10.0
"""As tf2's default."""


@dataclass(frozen=True, order=True)
class Heard:
    """One transform: `number` and `process` are where the tests' nodes have their sequence and process."""

    stamp_s: float
    parent: str
    number: int
    process: int
    at_s: float


@dataclass
class TransformBuffer:
    """Takes transforms in the order of arrival.

    Attributes:
        arrived: all of each child frame, in the order of arrival. known: those of the last seconds, by stamp.
        fixed: the static ones. faults: what tf2 would warn of.
    """

    arrived: dict[str, list[Heard]] = field(default_factory=dict)
    known: dict[str, list[Heard]] = field(default_factory=dict)
    fixed: dict[str, str] = field(default_factory=dict)
    faults: list[str] = field(default_factory=list)

    def take(self, message: Any, at_s: float) -> None:
        """Takes a TFMessage."""
        for one in message.transforms:
            stamp_s = one.header.stamp.sec + one.header.stamp.nanosec / 1e9
            where = one.transform.translation
            heard = Heard(stamp_s, one.header.frame_id, int(where.x), int(where.y), at_s)
            self._keep(one.child_frame_id, heard)

    def _keep(self, child: str, heard: Heard) -> None:
        before = self.known.setdefault(child, [])
        if any(one.stamp_s == heard.stamp_s for one in before):
            self.faults.append(f"TF_REPEATED_DATA {child} {heard}")
            return
        if before and heard.stamp_s < before[-1].stamp_s - KEPT_S:
            self.faults.append(f"TF_OLD_DATA {child} {heard}")
            return
        if before and before[-1].parent != heard.parent:
            self.faults.append(f"{child} has two parents: {before[-1]} and {heard}")
        insort(before, heard)
        while before[0].stamp_s < before[-1].stamp_s - KEPT_S:
            before.pop(0)
        self.arrived.setdefault(child, []).append(heard)

    def take_fixed(self, message: Any) -> None:
        """Takes a TFMessage of /tf_static; the newest counts."""
        self.fixed |= {one.child_frame_id: one.header.frame_id for one in message.transforms}

    def reaches(self, child: str, root: str, stamp_s: float) -> str:
        """Returns "" when `child` can be expressed in `root` at a stamp, else what tf2 would throw."""
        frame = child
        while frame != root:
            if frame in self.fixed:
                frame = self.fixed[frame]
                continue
            known = self.known.get(frame, [])
            if not known:
                return f"ConnectivityException: {frame}"
            place = bisect_left([one.stamp_s for one in known], stamp_s)
            if place == len(known):
                return f"ExtrapolationException into the future: {frame}"
            if place == 0 and known[0].stamp_s > stamp_s:
                return f"ExtrapolationException into the past: {frame}"
            frame = known[place].parent
        return ""

    def gap_s(self, child: str) -> float:
        """Returns the longest time between two arrivals of a frame, seconds."""
        return max(later.at_s - earlier.at_s for earlier, later in pairwise(self.arrived[child]))

    def stays(self, child: str) -> list[int]:
        """Returns the processes that published a frame, one for each run of messages."""
        processes = [one.process for one in self.arrived[child]]
        return [one for place, one in enumerate(processes) if place == 0 or processes[place - 1] != one]

    def out_of_order(self) -> list[str]:
        """Returns the frames of which a publisher's numbers do not grow."""
        found = []
        for child, heard in self.arrived.items():
            for process in {one.process for one in heard}:
                numbers = [one.number for one in heard if one.process == process]
                found += [f"{child} of {process}"] if numbers != sorted(set(numbers)) else []
        return found
