"""How long a message waited between its publisher and this process, without comparing the clocks of two hosts.

A message can wait for the one thread that takes it while the other threads run, so that there is no pause: on a host
that lends out its processors, a single one may stand still. The publisher's middleware stamps each message. The time
from that stamp to now is clock offset + minimum transit + waiting time. As in LEDBAT (RFC 6817, base delay of one
direction), its recent minimum estimates the first two.
"""

from __future__ import annotations

import math

WAITS_WINDOW_S = 10.0
"""The minimum is that of the present window and the one before: after two windows a set clock is believed."""
STEP_S = 0.020
"""A larger step of the system clock between two messages is not slewing: the clock was set."""
ON_THE_WAY_S = 1.0
"""After the clock was set back, messages on their way seem to arrive before they left: nothing is learned from them."""


class Waits:
    """Waiting times of the messages of one topic; called on one thread."""

    def __init__(self) -> None:
        self.shortest_s = math.inf
        self.shortest_before_s = math.inf
        self.window_s = -math.inf
        self.clock_s = -math.inf
        self.learns_s = -math.inf

    def waited_s(self, published_s: float, system_s: float, now_s: float) -> float:
        """Return how much longer a message was under way than the recent minimum; 0 if none is known.

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
