"""What a process can know about arrivals at another process."""

from __future__ import annotations

from collections import deque


class Known:
    """Times of arrivals, of which another process learns up to `late_s` later.

    Several may come within that time (a burst after a cut), so one time before the newest is not enough.

    Args:
        late_s: the longest delay between the two processes.
    """

    def __init__(self, late_s: float) -> None:
        self.late_s = late_s
        self._came_s = deque([0.0])

    def came(self, now_s: float) -> None:
        """Note that something came now."""
        while len(self._came_s) > 1 and now_s - self._came_s[1] > self.late_s:
            self._came_s.popleft()
        self._came_s.append(now_s)

    def newest_s(self, now_s: float) -> float:
        """Return the time of the newest arrival that the process must know by now; 0: none."""
        return max((came_s for came_s in self._came_s if now_s - came_s > self.late_s), default=0.0)
