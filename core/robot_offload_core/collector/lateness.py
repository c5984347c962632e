"""How late the messages of one output come, and when a missing message counts as lost.

This is for outputs whose replica on the robot is Hot: it can go on at once, without waiting for the loss timeout. The
margin follows the largest lateness of the last minute, not a quantile: messages cut off by a takeover would be missing
from a quantile, which would shrink until it cuts off healthy messages.
"""

from __future__ import annotations

from dataclasses import dataclass

from robot_offload_core.fence.token import Token
from robot_offload_core.words.replace import replace

LATENESS_WINDOW_S = 60.0
"""Window of the messages that are compared."""
FACTOR = 1.5
EXTRA_S = 0.005
"""Added to FACTOR times the largest lateness of the window."""
LEAST_S = 0.010
"""Least margin for a message."""
TAUGHT = 100
"""With fewer messages than this, the margin is the loss timeout."""
FLOOR_S = 600.0
"""How long the margin stays up after a message counted as lost came after all."""
BUCKET_S = 1.0
"""Within this time only the largest lateness is kept."""


@dataclass(frozen=True)
class Lateness:
    """Lateness of one output of the cloud. Times on the robot's steady clock, seconds.

    Attributes:
        token, sequence, arrived_s: of the newest message; token None before the first.
        seen: number of messages whose lateness is known, up to TAUGHT.
        late: (arrival, lateness) of the latest messages, lateness falling: the first is the largest of the last minute.
        missed: the message after the newest one counts as lost.
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
    """Record how late a message of the cloud came, even if it no longer passes.

    Only messages of the same token within the output's deadline count. A later one shows an outage: the hard limit ends
    the stay then, and the margin need not cover it. Messages lost in between add to the lateness of the next one:
    without retransmission (best effort) such losses are usual, and not an outage.
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
    """Return the margin after a period before the next message counts as lost, seconds.

    Args:
        known: lateness so far.
        now_s: on the robot's steady clock.
        untaught_s: margin while fewer than TAUGHT messages are known.
        least_s: least margin, learned by control from its mistakes (fast_takeover.py).
        most_s: largest margin: from a period to the output's deadline, at which silence is a fault anyway.
    """
    if known.seen < TAUGHT:
        return min(max(untaught_s, least_s), most_s)
    largest_s = next((value_s for at_s, value_s in known.late if now_s - at_s <= LATENESS_WINDOW_S), 0.0)
    wanted_s = max(FACTOR * largest_s + EXTRA_S, LEAST_S, _floor_s(known, now_s), least_s)
    return min(wanted_s, most_s)


def _floor_s(known: Lateness, now_s: float) -> float:
    return known.floor_s if now_s < known.floor_until_s else 0.0
