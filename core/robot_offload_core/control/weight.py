"""How much of the robot's computer the agent takes: it is there for nodes that need what is left."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from robot_offload_core.words.problems import Problem

WINDOW_S: Final = 60.0
"""Shorter peaks, such as a start or a change of the side, are not heavy."""
HEAVY_SHARE: Final = 0.1
"""Share of all cores above which a person should know: almost half a core of four."""


@dataclass(frozen=True)
class Weight:
    """Readings of the last minute.

    Attributes:
        readings: (when, processor time used so far by all processes of the agent), seconds; the oldest first.
    """

    readings: tuple[tuple[float, float], ...] = ()


def read(weight: Weight, used_s: float, now_s: float) -> Weight:
    """Take a reading; begin anew when a process has ended and taken its processor time with it."""
    if weight.readings and used_s < weight.readings[-1][1]:
        return Weight(((now_s, used_s),))
    old = sum(now_s - at_s >= WINDOW_S for at_s, _ in weight.readings)
    return Weight((*weight.readings[max(0, old - 1) :], (now_s, used_s)))


def share(weight: Weight, cores: int) -> float | None:
    """Return the share of all cores that the agent used in the last minute, 0..1; None before a minute has passed."""
    if not weight.readings:
        return None
    (first_s, first_used_s), (last_s, last_used_s) = weight.readings[0], weight.readings[-1]
    if last_s - first_s < WINDOW_S:
        return None
    return (last_used_s - first_used_s) / (last_s - first_s) / cores


def problem(weight: Weight, cores: int) -> tuple[str, str] | None:
    """Return (reason, message) while the agent takes more of the computer than it should."""
    taken = share(weight, cores)
    if taken is None or taken <= HEAVY_SHARE:
        return None
    tenths = int(taken / HEAVY_SHARE + 1e-9)  # a figure that changed each time would be logged each time
    return Problem.AGENT_HEAVY, (
        f"The agent takes more than {tenths * HEAVY_SHARE:.0%} of this computer's processor ({cores} cores): a longer "
        "switching.heartbeatPeriod and fewer messages (topics.toCloud: rate) take less of it"
    )
