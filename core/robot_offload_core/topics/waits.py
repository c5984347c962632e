"""How long a message waited between its publisher and this process, without comparing the clocks of two hosts.

A process whose other threads work has no pause, and still a message can wait for the one thread that takes it: on a
machine that lends out its processors a single one of them may stand still. The publisher's middleware stamps each
message; what is between that stamp and now holds the difference of two clocks, the shortest way, and the wait. The
smallest of late is taken for the first two, as LEDBAT does with delays of one direction (RFC 6817, base delay).
"""

from __future__ import annotations

import math

WAITS_WINDOW_S = 10.0
"""The smallest way is that of the present window and the one before: a clock that was set is believed after two."""
STEP_S = 0.020
"""More than a system clock is slewed by between two messages: it was set."""
ON_THE_WAY_S = 1.0
"""What was on its way when the clock was set back seems to have come before it left: nothing is learnt from it."""


class Waits:
    """Fed with each message of one topic, on one thread."""

    def __init__(self) -> None:
        self.shortest_s = math.inf
        self.shortest_before_s = math.inf
        self.window_s = -math.inf
        self.clock_s = -math.inf
        self.learns_s = -math.inf

    def waited_s(self, published_s: float, system_s: float, now_s: float) -> float:
        """Return how much longer the way of a message was than the shortest one of late, 0 where nothing is known.

        Args:
            published_s: the publisher's stamp, by the system clock of its host.
            system_s: our system clock.
            now_s: our steady clock.
        """
        clock_s, before_s = system_s - now_s, self.clock_s
        self.clock_s = clock_s
        if clock_s < before_s - STEP_S:
            self.learns_s = now_s + ON_THE_WAY_S
        if now_s < self.learns_s:
            return 0.0
        if now_s - self.window_s > WAITS_WINDOW_S:
            idle = now_s - self.window_s > 2 * WAITS_WINDOW_S
            self.shortest_before_s = math.inf if idle else self.shortest_s
            self.shortest_s, self.window_s = math.inf, now_s
        way_s = system_s - published_s
        self.shortest_s = min(self.shortest_s, way_s)
        return way_s - min(self.shortest_s, self.shortest_before_s)
