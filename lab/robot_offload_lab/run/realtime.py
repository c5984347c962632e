"""Real-time priority for the processes of a run, as the bundle's systemd unit gives it to a robot's agent."""

from __future__ import annotations

import os
import threading
from typing import Final

HIGHEST_PRIORITY: Final = 20
"""Above every process of a run; the highest that the bundle's unit permits (LimitRTPRIO)."""


def take(priority: int) -> bool:
    """Put the calling thread under SCHED_FIFO; return whether that is permitted."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except PermissionError:
        return False
    return True


def is_permitted() -> bool:
    """Return whether processes that this one starts may take real-time priority; a short-lived thread tries it."""
    answers: list[bool] = []
    thread = threading.Thread(target=lambda: answers.append(take(HIGHEST_PRIORITY)), name="realtime")
    thread.start()
    thread.join()
    return answers == [True]
