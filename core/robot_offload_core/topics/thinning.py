"""How much of a topic the link takes, and the problem if that is less than published. Pure: time is an argument."""

from __future__ import annotations

from dataclasses import dataclass

THINNING_WINDOW_S = 5.0
"""Window of the count: long enough that a single cut of a second does not count as thinning."""
LEAST_OFFERED = 10
LEAST_REFUSED_SHARE = 0.2
MISSED_SHARE = 0.9
"""A rate below this share misses `minRate`, as a window cuts off one message at either end."""
CURE = "Publish it smaller, compressed or more seldom"


@dataclass
class Thinning:
    """Counts one topic's messages in windows.

    Attributes:
        began_s: when the present window began.
        offered, sent, sent_bytes: messages and bytes since then.
        problem: (reason, message) of the last whole window; None: the link took nearly everything.
    """

    began_s: float
    offered: int = 0
    sent: int = 0
    sent_bytes: int = 0
    problem: tuple[str, str] | None = None

    def count(self, size: int, *, sent: bool) -> None:
        """Count a message that was offered to the link; `size`: bytes that the link took."""
        self.offered += 1
        self.sent += sent
        self.sent_bytes += size

    def count_later(self, size: int) -> None:
        """Count a refused message that the link took after all."""
        self.sent += 1
        self.sent_bytes += size

    def is_due(self, now_s: float) -> bool:
        """Return whether the window is over."""
        return now_s - self.began_s >= THINNING_WINDOW_S

    def judge(self, name: str, now_s: float, *, connected: bool, slowest_s: float = 0.0) -> tuple[str, str] | None:
        """End the window; return the problem, (reason, message), that it shows, or None.

        Args:
            name: of the topic.
            now_s: the present.
            connected: whether there is a session; without one there is no link, and nothing counts as thinned.
            slowest_s: declared longest time between two messages; 0: none.
        """
        passed_s, offered, sent, size = now_s - self.began_s, self.offered, self.sent, self.sent_bytes
        refused = offered - sent
        self.began_s, self.offered, self.sent, self.sent_bytes = now_s, 0, 0, 0
        self.problem = None
        if connected and offered >= LEAST_OFFERED and refused >= LEAST_REFUSED_SHARE * offered:
            carried = (
                f"The link carries {sent / passed_s:.1f} of {offered / passed_s:.1f} messages a second of {name} "
                f"({size / passed_s / 1e6:.1f} MB/s)"
            )
            missed = slowest_s and sent / passed_s < MISSED_SHARE / slowest_s
            if missed:
                message = f"{carried}, fewer than its minRate of {1 / slowest_s:g}. {CURE}"
            elif slowest_s:
                message = f"{carried}; it is thinned evenly, down to its minRate of {1 / slowest_s:g} at most"
            else:
                message = f"{carried}; what would have to wait is left out. {CURE}"
            self.problem = ("MinRateMissed" if missed else "Thinned", message)
        return self.problem
