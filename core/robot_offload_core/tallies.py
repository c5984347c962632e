"""Counts for people and for metrics; no decision is taken on them.

A histogram is a list of counts: one for each bound, of the values that do not exceed it and exceed the bound before,
and one for what exceeds all. Together with the sum that is what Prometheus needs, and counts add up.
"""

from __future__ import annotations

from bisect import bisect_left
from math import inf

from robot_offload_core.links import Link
from robot_offload_core.placement import Decided
from robot_offload_core.token import Site

LATENCY_MS = (5, 10, 15, 20, 30, 50, 75, 100, 150, 200, 300, 500, 1000)
"""Bounds of the link's latency: finest where the limits of most loops lie."""
GAP_MS = (25, 50, 75, 100, 125, 150, 200, 300, 500, 1000, 2000)
"""Bounds of the time between two commands."""
IN_FLIGHT = ("running", "waiting", "resent")
"""Of an action's goals: executed now, waiting for a side that can, and how often an execution began anew."""
SWITCH_S = 1.0
"""A silence that begins within this time after a change of side belongs to it; a later one has other causes."""

AGE_COUNTS_S = 5.0
"""The age of a topic whose newest message came longer ago says nothing."""


def bucket(bounds: tuple[int, ...], value: float) -> int:
    """Returns the index of the count to which a value belongs."""
    return bisect_left(bounds, value)


class LinkTally:
    """What a control process has seen of its link and of its changes since its start.

    Attributes:
        latency: counts by LATENCY_MS. latency_sum_ms: of all round trips.
        received, lost: beats of the other side.
        changeovers: by (side that took over, reason).
        losses: sudden losses of the cloud. false_alarms: those after which a beat came within another `lossTimeout`.
        silence_ms: without a good beat before the robot took over, all together.
    """

    def __init__(self) -> None:
        self.latency = [0] * (len(LATENCY_MS) + 1)
        self.latency_sum_ms = 0.0
        self.received = self.lost = 0
        self.changeovers: dict[tuple[str, str], int] = {}
        self.losses = self.false_alarms = 0
        self.silence_ms = 0.0
        self._seen = Link()
        self._alarm: tuple[str, float] = ("", 0.0)

    def look(self, link: Link, now_s: float, loss_timeout_s: float) -> None:
        """Takes the link after a beat."""
        seen, self._seen = self._seen, link
        if link is seen or not link.peer:
            return
        same = link.peer == seen.peer and link.last_sequence >= seen.last_sequence
        heard = link.received - (seen.received if same else 0)
        if heard <= 0:
            return
        due = link.last_sequence - (seen.last_sequence if same else link.first_sequence - 1)
        self.received += heard
        self.lost += max(0, due - heard)
        peer, until_s = self._alarm
        if peer == link.peer and now_s <= until_s + loss_timeout_s:
            self.false_alarms += 1
        self._alarm = ("", 0.0)
        if link.round_trip_s is not None and link.echo_sent_s != seen.echo_sent_s:
            self.latency[bucket(LATENCY_MS, link.round_trip_s * 1e3)] += 1
            self.latency_sum_ms += link.round_trip_s * 1e3

    def decided(self, decided: Decided, peer: str, now_s: float) -> None:
        """Takes a decision about the placement; `peer` is the cloud that was heard until then."""
        if not decided.switched:
            return
        key = (decided.site.value, decided.verdict.reason.value)
        self.changeovers[key] = self.changeovers.get(key, 0) + 1
        if decided.site is Site.ROBOT and decided.silent_s is not None:
            self.losses += 1
            self.silence_ms += decided.silent_s * 1e3
            self._alarm = (peer, now_s)


class SwitchSilence:
    """The longest time between two commands around the last change of the side that passes.

    Attributes:
        site: that passes now.
        changed_s: when that changed last; None: it has not.
        gap_ms: the longest silence that ended after the change, and began before it or within SWITCH_S of it; None:
            none has ended yet.
    """

    def __init__(self, site: Site) -> None:
        self.site = site
        self.changed_s: float | None = None
        self.gap_ms: float | None = None

    def passes(self, site: Site, now_s: float) -> None:
        """Takes the side that passes from now on."""
        if site is not self.site:
            self.site, self.changed_s, self.gap_ms = site, now_s, None

    def ended(self, before_s: float, now_s: float) -> None:
        """Takes the moments of two commands of one output that follow each other."""
        if self.changed_s is not None and before_s <= self.changed_s + SWITCH_S:
            self.gap_ms = max(self.gap_ms or 0.0, (now_s - before_s) * 1e3)

    def known(self, now_s: float) -> tuple[Site, float, float] | None:
        """Returns the side, when it began to pass, and the silence around that; None: it is not over yet."""
        if self.changed_s is None or self.gap_ms is None or now_s <= self.changed_s + SWITCH_S:
            return None
        return self.site, self.changed_s, round(self.gap_ms, 1)


class Ages:
    """How old the newest message of each topic was when it came; one of a latched topic holds at any age."""

    def __init__(self) -> None:
        self._newest: dict[str, tuple[float, float]] = {}

    def came(self, name: str, age_s: float, now_s: float) -> None:
        """Takes a message; an age that is not known is infinite."""
        self._newest[name] = now_s, age_s

    def known(self, now_s: float) -> tuple[tuple[str, int], ...]:
        """Returns the ages in ms of topics that speak now."""
        newest = self._newest.copy()  # another thread may add to them
        fresh = {name: age_s for name, (at_s, age_s) in newest.items() if now_s - at_s <= AGE_COUNTS_S and age_s < inf}
        return tuple((name, round(age_s * 1e3)) for name, age_s in fresh.items())
