"""Counts for people and for metrics; no decision is based on them.

A histogram is a list of counts: for each bound, the values above the previous bound and not above this one; and last
the values above all bounds. With their sum, that is what Prometheus needs, and counts can be added.
"""

from __future__ import annotations

from bisect import bisect_left
from math import inf

from robot_offload_core.fence.token import Site

GAP_MS = (25, 50, 75, 100, 125, 150, 200, 300, 500, 1000, 2000)
"""Bounds of the time between two commands."""

SWITCH_S = 1.0
"""A silence that begins within this time after a change of side belongs to it; a later one has other causes."""

AGE_COUNTS_S = 5.0
"""The age of a topic means nothing if its newest message came longer ago."""


class SwitchSilence:
    """The longest time between two commands around the last change of the side that passes.

    Attributes:
        site: the side that passes now.
        changed_s: time of the last change; None: no change yet.
        gap_ms: the longest silence that ended after the change, and began before it or within SWITCH_S after it; None:
            none has ended yet.
    """

    def __init__(self, site: Site) -> None:
        self.site = site
        self.changed_s: float | None = None
        self.gap_ms: float | None = None

    def passes(self, site: Site, now_s: float) -> None:
        """Take the side that passes from now on."""
        if site is not self.site:
            self.site, self.changed_s, self.gap_ms = site, now_s, None

    def ended(self, before_s: float, now_s: float) -> None:
        """Take the times of two successive commands of one output."""
        if self.changed_s is not None and before_s <= self.changed_s + SWITCH_S:
            self.gap_ms = max(self.gap_ms or 0.0, (now_s - before_s) * 1e3)

    def known(self, now_s: float) -> tuple[Site, float, float] | None:
        """Return the side, when it began to pass, and the silence around that time; None if that is not over yet."""
        if self.changed_s is None or self.gap_ms is None or now_s <= self.changed_s + SWITCH_S:
            return None
        return self.site, self.changed_s, round(self.gap_ms, 1)


class Ages:
    """How old the newest message of each topic was when it came; a latched message is valid at any age."""

    def __init__(self) -> None:
        self._newest: dict[str, tuple[float, float]] = {}

    def came(self, name: str, age_s: float, now_s: float) -> None:
        """Take a message; an unknown age is infinite."""
        self._newest[name] = now_s, age_s

    def known(self, now_s: float) -> tuple[tuple[str, int], ...]:
        """Return the ages in ms of topics with a recent message."""
        newest = self._newest.copy()  # another thread may add to them
        fresh = {name: age_s for name, (at_s, age_s) in newest.items() if now_s - at_s <= AGE_COUNTS_S and age_s < inf}
        return tuple((name, round(age_s * 1e3)) for name, age_s in fresh.items())


def bucket(bounds: tuple[int, ...], value: float) -> int:
    """Return the index of the count to which a value belongs."""
    return bisect_left(bounds, value)
