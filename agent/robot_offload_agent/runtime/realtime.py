"""Real-time priority for the processes that must not wait."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

PULSE_PRIORITY = 10
DEFAULT_PRIORITY = 5
START_PRIORITY = 1
"""Priority of a collector that starts: above the robot's load, below every process of the agent that already works."""


def request(wanted: bool, priority: int) -> str:
    """Put all threads of this process, and those that they will start, under SCHED_FIFO.

    A process asks for it when it has started: a start takes a tenth of a second of computing that would hold up the
    processes that work, and threads of one priority do not take turns.

    Returns:
        `fifo` or `normal`, or a warning that states how to permit it.
    """
    if not wanted:
        return "normal"
    parameters = os.sched_param(priority)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, parameters)
    except PermissionError:
        return (
            "Real-time priority is not permitted: grant CAP_SYS_NICE or set LimitRTPRIO=20 in the service unit; "
            "going on with normal priority, expect more false alarms under load"
        )
    done: set[str] = set()
    while new := {path.name for path in Path("/proc/self/task").iterdir()} - done:
        for thread in new:
            with suppress(ProcessLookupError):  # it has ended
                os.sched_setscheduler(int(thread), os.SCHED_FIFO, parameters)
        done |= new
    return "fifo"
