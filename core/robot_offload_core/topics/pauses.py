"""Detect that this process did not run for a while: stopped, starved, or its host frozen.

Messages that waited in its queues look new when they are handled, but are not. Their age is unknown without comparing
clocks, so messages that must be fresh are left out for as long as emptying the queues takes.
"""

from __future__ import annotations

LIMIT_S = 0.120
"""A gap between two signs of life that counts as a pause: six turns of a loop of 20 ms, below any useful age limit."""
DRAIN_S = 0.050
"""How long after a pause the queues may still hold messages that waited."""


class Pauses:
    """Finds pauses in the signs of life of a process, which may come from any thread."""

    def __init__(self, now: float) -> None:
        self.alive_s = now
        self.until_s = 0.0
        self.lasted_s = 0.0

    def waited(self, now: float) -> bool:
        """Record a sign of life; return whether a message handled now may have waited through a pause."""
        if now - self.alive_s > LIMIT_S:
            self.until_s, self.lasted_s = now + DRAIN_S, now - self.alive_s
        self.alive_s = now
        return now < self.until_s

    def at_most_s(self, now: float) -> float:
        """Record a sign of life; return how long a message handled now may have waited in a pause, 0 without one."""
        return self.lasted_s + DRAIN_S if self.waited(now) else 0.0
