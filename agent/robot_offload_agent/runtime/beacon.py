"""Signs of life of a process for its supervisor, which ends a process that hangs."""

from __future__ import annotations

import os

from robot_offload_agent.runtime.bus import Bus
from robot_offload_agent.runtime.clock import now_s
from robot_offload_core.words.messages import Alive

PERIOD_S = 0.5


class Beacon:
    """Collects the signs of a process's threads; whichever thread comes first sends them on.

    A sign carries the age of the oldest one, so a hanging thread is noticed while the others go on.
    """

    def __init__(self, bus: Bus, *threads: str) -> None:
        """`threads` are those that call `sign` at least once in two seconds as long as they work."""
        self.bus = bus
        self.signed_s = dict.fromkeys(threads, now_s())
        self.due_s = 0.0

    def sign(self, thread: str) -> None:
        """Sign that a thread is alive; cheap enough for every turn of a loop."""
        now = self.signed_s[thread] = now_s()
        if now >= self.due_s:
            self.due_s = now + PERIOD_S
            # No hurry: the supervisor reads its inbox as often as this by itself.
            self.bus.renew("supervisor", Alive(self.bus.name, os.getpid(), now - min(self.signed_s.values())))
