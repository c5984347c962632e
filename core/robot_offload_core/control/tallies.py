"""Counters of a control process about its link and its changes of side."""

from __future__ import annotations

from robot_offload_core.fence.token import Site
from robot_offload_core.link.links import Link
from robot_offload_core.topics.tallies import bucket
from robot_offload_core.words.decided import Decided

LATENCY_MS = (5, 10, 15, 20, 30, 50, 75, 100, 150, 200, 300, 500, 1000)
"""Bounds of the link's latency: finest where the limits of most loops lie."""
IN_FLIGHT = ("running", "waiting", "resent")
"""Counts of an action's goals: executed now, waiting for an able side, and executions begun anew."""


class LinkTally:
    """Counters of the link and of the changes of side since the start of a control process.

    Attributes:
        latency: counts by LATENCY_MS.
        latency_sum_ms: sum of all round trips.
        received, lost: beats of the other side.
        changeovers: counts by (side that took over, reason).
        losses: sudden losses of the cloud.
        false_alarms: losses after which a beat came within another `lossTimeout`.
        silence_ms: total time without a good beat before the robot took over.
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
        """Count what a beat has changed in the link."""
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
        """Count a decision about the placement; `peer` is the cloud that was heard until then."""
        if not decided.switched:
            return
        key = (decided.site.value, decided.verdict.reason.value)
        self.changeovers[key] = self.changeovers.get(key, 0) + 1
        if decided.site is Site.ROBOT and decided.silent_s is not None:
            self.losses += 1
            self.silence_ms += decided.silent_s * 1e3
            self._alarm = (peer, now_s)
