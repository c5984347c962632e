"""Latency and loss of a link as of now, for people who watch: Health sums up, and no decision is taken on this."""

from __future__ import annotations

from dataclasses import dataclass

from robot_offload_core.link import links
from robot_offload_core.link.links import Link
from robot_offload_core.words.replace import replace

LOSS_WINDOW_S = 2.0
"""Loss is the share of the beats of this time: a hundred at the default period, so one lost beat is one per cent."""
SLACK_BEATS = 2
"""So many beats may be on their way before the silence counts as loss."""


@dataclass(frozen=True)
class Glance:
    """The link at one moment.

    Attributes:
        latency_ms: the loop latency that counts now, with overdue echoes; None: no loop is known.
        loss_share: of the last LOSS_WINDOW_S, the beats that should have come and did not, 0 to 1; None: none was due.
    """

    latency_ms: float | None = None
    loss_share: float | None = None


@dataclass(frozen=True)
class Watched:
    """What was seen of a link within the window, oldest first: (steady clock in seconds, the link)."""

    seen: tuple[tuple[float, Link], ...] = ()


def watch(watched: Watched, link: Link, now_s: float) -> Watched:
    """Take one look at the link; look older than the window are dropped, but for the one at its edge."""
    kept = watched.seen if watched.seen and watched.seen[-1][1].peer == link.peer else ()
    while len(kept) > 1 and kept[1][0] <= now_s - LOSS_WINDOW_S:
        kept = kept[1:]
    return replace(watched, seen=(*kept, (now_s, replace(link, window=()))))


def glance(watched: Watched, now_s: float, beat_period_s: float) -> Glance:
    """Return what the newest look shows at `now_s`."""
    if not watched.seen or watched.seen[-1][1].heard_s is None:
        return Glance()
    (_, then), (_, link) = watched.seen[0], watched.seen[-1]
    latency_s = links.latency_s(link, now_s, beat_period_s)
    expected, received = link.last_sequence - then.last_sequence, link.received - then.received
    if expected < 0:  # the sender's pulse process restarted and counts from 0 again
        expected, received = link.last_sequence - link.first_sequence + 1, link.received
    assert link.heard_s is not None
    expected += max(0, int((now_s - link.heard_s) / beat_period_s) - SLACK_BEATS)
    return Glance(
        None if latency_s == float("inf") else round(latency_s * 1e3, 2),
        round(min(1.0, max(0.0, 1 - received / expected)), 4) if expected > 0 else None,
    )
