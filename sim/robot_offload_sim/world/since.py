"""The part of a message's age that the observer excuses: unknowable without comparing two hosts' clocks."""

from __future__ import annotations

import math

from robot_offload_core.topics.waits import ON_THE_WAY_S, WAITS_WINDOW_S
from robot_offload_sim.world.world import IPC_LEAST_S, IPC_SPREAD_S, Host


class Since:
    """The time from which the age of a topic's messages can be counted, including any wait for the data process."""

    def __init__(self) -> None:
        self.unwaited_s = self.set_back_s = -1e9
        self.wall_us = -math.inf

    def counts_s(self, host: Host, born_s: float) -> float:
        """Return a true time: `born_s`, that of publishing, if it can be known.

        Otherwise return now: no message came without waiting recently, or the system clock was set back, so the
        delay so far cannot be known.
        """
        now = host.world.now
        if host.wall_us < self.wall_us:
            self.set_back_s = now
        self.wall_us = host.wall_us
        if now - born_s <= IPC_LEAST_S + IPC_SPREAD_S + 1e-6:
            self.unwaited_s = now
        known = now - self.unwaited_s < WAITS_WINDOW_S and now - self.set_back_s > ON_THE_WAY_S * 1.01
        return born_s if known else now
