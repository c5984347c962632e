"""Rated outputs that are slower than nodes wake: what their silence proves, and when it stops a robot.

A prompt output proves within the activation deadline that its side lives. A slow one cannot: its next message may be a
period away, so that nobody waits for it. It is silent when its `deadline` has passed since it, or something that may
have interrupted it, was last seen: a message, a new charge, its node's return. A node that returns again and again
without a message earns one such deadline, not one for each return.
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
    """What is known of one. Times on the robot's steady clock, seconds.

    Attributes:
        index: of the output.
        deadline_s: see OutputSpec.
        seen_s: the last time that the collector knew a message of it that was younger than its deadline.
        asleep: its node is not Active, or not seen.
        woken_s: from when the return of its node counts.
    """

    index: int
    deadline_s: float
    seen_s: float = NEVER_S
    asleep: bool = False
    woken_s: float = NEVER_S

    def excused(self, now_s: float) -> bool:
        """Return whether its node has returned no longer ago than it may be silent."""
        return now_s - self.woken_s <= self.deadline_s

    def unseen(self, since_s: float, now_s: float) -> bool:
        """Return whether nothing is known of it since `since_s`, for longer than it may be silent."""
        return now_s - max(since_s, self.seen_s, self.woken_s) > self.deadline_s


def start(outputs: tuple[OutputSpec, ...]) -> tuple[SlowOutput, ...]:
    """Return what is known at the start: of every rated output, because which ones are slow is a setting."""
    return tuple(SlowOutput(i, o.deadline_s) for i, o in enumerate(outputs) if o.rated)


def is_slow(output: OutputSpec, activation_s: float) -> bool:
    """Return whether a rated output has more time for its next message than nodes have to wake (0: unknown, no)."""
    return output.rated and 0.0 < activation_s < output.deadline_s


def see(known: tuple[SlowOutput, ...], flowing: Collection[int], now_s: float) -> tuple[SlowOutput, ...]:
    """Note the outputs, by index, of which the collector knows a message in time."""
    return tuple(replace(one, seen_s=now_s) if one.index in flowing else one for one in known)


def wake(known: tuple[SlowOutput, ...], asleep: Collection[int], now_s: float) -> tuple[SlowOutput, ...]:
    """Note whose nodes sleep. A return counts when a message was seen since the one that counted before."""
    return tuple(_woken(one, one.index in asleep, now_s) for one in known)


def _woken(one: SlowOutput, asleep: bool, now_s: float) -> SlowOutput:
    returns = one.asleep and not asleep and one.seen_s > one.woken_s
    return replace(one, asleep=asleep, woken_s=now_s if returns else one.woken_s)
