"""Present latency and loss of a link, for people who watch (Health covers more time); no decision is based on it."""

from __future__ import annotations

from dataclasses import dataclass

from robot_offload_core.link import links
from robot_offload_core.link.links import Link
from robot_offload_core.words.replace import replace

LOSS_WINDOW_S = 2.0
"""Loss is a share of the beats of this window: a hundred at the default period, so one lost beat is one per cent."""
SLACK_BEATS = 2
"""Beats that may be on their way before silence counts as loss."""


@dataclass(frozen=True)
class Glance:
    """The link at one moment.

    Attributes:
        latency_ms: present loop latency, including overdue echoes; None: no loop is known.
        loss_share: share of the beats due in the last LOSS_WINDOW_S that did not come, 0 to 1; None: none was due.
    """

    latency_ms: float | None = None
    loss_share: float | None = None


@dataclass(frozen=True)
class Watched:
    """Looks at a link within the window, oldest first: (steady clock in seconds, the link)."""

    seen: tuple[tuple[float, Link], ...] = ()


def watch(watched: Watched, link: Link, now_s: float) -> Watched:
    """Add a look at the link; drop looks older than the window, except the one at its edge."""
    kept = watched.seen if watched.seen and watched.seen[-1][1].peer == link.peer else ()
    while len(kept) > 1 and kept[1][0] <= now_s - LOSS_WINDOW_S:
        kept = kept[1:]
    return replace(watched, seen=(*kept, (now_s, replace(link, window=()))))


def glance(watched: Watched, now_s: float, beat_period_s: float) -> Glance:
    """Return latency and loss at `now_s`, from the looks so far."""
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
