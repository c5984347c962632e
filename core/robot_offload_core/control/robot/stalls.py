"""Steps of our own that came late: unread messages do not count as silence, but only for a while (see Stalls)."""

from __future__ import annotations

from robot_offload_core.control.robot.placement import Robot
from robot_offload_core.words.replace import replace

HEALTHY_S = 0.5
"""After this long without a stall our process counts as healthy: a later stall begins a new row (see Stalls)."""


def notice(robot: Robot, now_s: float) -> Robot:
    """Detect that our own steps came late.

    The queues between our processes are bounded: the last messages of a stall may be lost. Therefore silence counts
    from the end of the stall (for no longer than a lease, see limits.cloud_fault).
    """
    stalls, settings = robot.stalls, robot.settings
    if stalls.stepped_s is not None and now_s - stalls.stepped_s > settings.stall_s:
        in_a_row = stalls.last_s is not None and now_s - stalls.last_s < HEALTHY_S
        first_s = stalls.first_s if in_a_row else now_s
        stalls = replace(stalls, until_s=now_s + settings.loss_timeout_s, last_s=now_s, first_s=first_s)
    return replace(robot, stalls=replace(stalls, stepped_s=now_s))


def starved(robot: Robot, now_s: float) -> bool:
    """Return whether stalls have followed each other for longer than a lease, so that waiting no longer helps."""
    stalls = robot.stalls
    return now_s < stalls.until_s and now_s - stalls.first_s > robot.settings.lease_s
