"""Rated outputs that are slower than nodes activate: what their silence proves, and when it stops a robot.

A prompt output proves within the activation deadline that its side is alive. A slow output cannot: its next message may
be a period away, so no changeover waits for it. It is silent once its `deadline` has passed since its last message or
the last event that may have interrupted it: a new charge, or its node's return. A node that returns repeatedly without
a message gets one such deadline, not one for each return.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from robot_offload_core.words.replace import replace
from robot_offload_core.words.settings import OutputSpec

NEVER_S = -1e9
"""A time before all others."""


@dataclass(frozen=True)
class SlowOutput:
    """State of one slow output. Times on the robot's steady clock, seconds.

    Attributes:
        index: of the output.
        deadline_s: see OutputSpec.
        seen_s: when the collector last knew a message of the output younger than its deadline.
        asleep: its node is not Active, or not seen.
        woken_s: time of the return of its node that counts.
    """

    index: int
    deadline_s: float
    seen_s: float = NEVER_S
    asleep: bool = False
    woken_s: float = NEVER_S

    def excused(self, now_s: float) -> bool:
        """Return whether its node returned within the last deadline."""
        return now_s - self.woken_s <= self.deadline_s

    def unseen(self, since_s: float, now_s: float) -> bool:
        """Return whether it has been silent for more than its deadline, counted from `since_s` at the earliest."""
        return now_s - max(since_s, self.seen_s, self.woken_s) > self.deadline_s


def start(outputs: tuple[OutputSpec, ...]) -> tuple[SlowOutput, ...]:
    """Return the first state of every rated output, because the settings determine which ones are slow."""
    return tuple(SlowOutput(i, o.deadline_s) for i, o in enumerate(outputs) if o.rated)


def is_slow(output: OutputSpec, activation_s: float) -> bool:
    """Return whether a rated output's deadline is longer than nodes have to activate (0: unknown, False)."""
    return output.rated and 0.0 < activation_s < output.deadline_s


def see(known: tuple[SlowOutput, ...], flowing: Collection[int], now_s: float) -> tuple[SlowOutput, ...]:
    """Record that the collector knows a message in time of these outputs (by index)."""
    return tuple(replace(one, seen_s=now_s) if one.index in flowing else one for one in known)


def wake(known: tuple[SlowOutput, ...], asleep: Collection[int], now_s: float) -> tuple[SlowOutput, ...]:
    """Record whose nodes sleep. A return counts only if a message was seen since the last return that counted."""
    return tuple(_woken(one, one.index in asleep, now_s) for one in known)


def _woken(one: SlowOutput, asleep: bool, now_s: float) -> SlowOutput:
    returns = one.asleep and not asleep and one.seen_s > one.woken_s
    return replace(one, asleep=asleep, woken_s=now_s if returns else one.woken_s)
