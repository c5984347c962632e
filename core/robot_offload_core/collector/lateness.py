"""How late the messages of one output come, and from when on a message that has not come is taken for lost.

This is for outputs whose replica on the robot is Hot: it can go on at once, so its owner need not wait for the loss
timeout. The margin follows the latest message of the last minute, not a quantile: what a takeover cut off would be
missing from a quantile, which then would shrink until it cuts off healthy messages.
"""

from __future__ import annotations

from dataclasses import dataclass

from robot_offload_core.fence.token import Token
from robot_offload_core.words.replace import replace

LATENESS_WINDOW_S = 60.0
"""Messages of this window are compared."""
FACTOR = 1.5
EXTRA_S = 0.005
"""Added to the latest message of the window."""
LEAST_S = 0.010
"""Least margin with which a message is waited for."""
TAUGHT = 100
"""Fewer messages than this teach nothing: until then the margin is the loss timeout."""
FLOOR_S = 600.0
"""How long a message that was taken for lost, and came, keeps the margin up."""
BUCKET_S = 1.0
"""Within one second only the latest message is kept."""


@dataclass(frozen=True)
class Lateness:
    """What is known of one output of the cloud. Times on the robot's steady clock, seconds.

    Attributes:
        token, sequence, arrived_s: of the newest message; token None before the first.
        seen: messages whose lateness is known, up to TAUGHT.
        late: (arrival, lateness) of the latest messages, both falling: the first is the largest of the last minute.
        missed: the newest message was followed by such a silence that the next one was taken for lost.
        floor_s: least margin until floor_until_s.
    """

    token: Token | None = None
    sequence: int = -1
    arrived_s: float = 0.0
    seen: int = 0
    late: tuple[tuple[float, float], ...] = ()
    missed: bool = False
    floor_s: float = 0.0
    floor_until_s: float = 0.0


UNHEARD = Lateness()


def hear(known: Lateness, token: Token, sequence: int, now_s: float, period_s: float, deadline_s: float) -> Lateness:
    """Take a message of the cloud, also one that does not pass any more.

    Only messages of one token say something, and only those that came within the output's deadline: what comes later
    shows an outage, which ends a stay by the hard limit and is nothing to wait for. Messages that were lost in between
    are lateness of the next one: where nothing is sent again (best effort) that is usual, and no outage.
    """
    newer = replace(known, token=token, sequence=sequence, arrived_s=now_s, missed=False)
    if token == known.token and sequence <= known.sequence:
        return known
    late_s = now_s - known.arrived_s - period_s
    if token != known.token or late_s + period_s > deadline_s:
        return newer
    kept = [(at_s, value_s) for at_s, value_s in known.late if now_s - at_s <= LATENESS_WINDOW_S and value_s > late_s]
    if not kept or now_s - kept[-1][0] > BUCKET_S:
        kept.append((now_s, late_s))
    newer = replace(newer, seen=min(TAUGHT, known.seen + 1), late=tuple(kept))
    if known.missed:
        newer = replace(newer, floor_s=max(FACTOR * late_s, _floor_s(known, now_s)), floor_until_s=now_s + FLOOR_S)
    return newer


def margin_s(known: Lateness, now_s: float, untaught_s: float, least_s: float, most_s: float) -> float:
    """Return how much longer than a period the next message is waited for, seconds.

    Args:
        known: what the messages so far have taught.
        now_s: on the robot's steady clock.
        untaught_s: the margin while that is too little.
        least_s: what control has learned from its mistakes (fast_takeover.py).
        most_s: of any margin: from a period to the output's deadline, at which its silence is a fault anyway.
    """
    if known.seen < TAUGHT:
        return min(max(untaught_s, least_s), most_s)
    largest_s = next((value_s for at_s, value_s in known.late if now_s - at_s <= LATENESS_WINDOW_S), 0.0)
    wanted_s = max(FACTOR * largest_s + EXTRA_S, LEAST_S, _floor_s(known, now_s), least_s)
    return min(wanted_s, most_s)


def _floor_s(known: Lateness, now_s: float) -> float:
    return known.floor_s if now_s < known.floor_until_s else 0.0
