"""Other rules to compare with, each given the same echoes at the same moments."""

from __future__ import annotations

from collections import deque
from typing import Final

from robot_offload_core.fence.token import Site
from robot_offload_core.words.settings import Settings
from robot_offload_lab.replay.contract import Decision

DWELL_S: Final = 20.0
WINDOW_S: Final = 3.0
WINDOW_LOSS_S: Final = 10.0


class OneSide:
    """Always one side: the baseline that the others must beat."""

    def __init__(self, site: Site) -> None:
        self._verdict = Decision(site, "Always", f"The {site.value} always acts")

    def heard(self, sent_s: float, arrived_s: float) -> None:
        """Ignore the echo."""

    def place(self, now_s: float) -> Decision:
        """Return the one side."""
        return self._verdict


class Threshold:
    """The rule of the thesis that this project grew out of: one message against one threshold, no hysteresis.

    The cloud acts while the newest echo took no longer than the limit. When nothing comes for the loss timeout, the
    status is 0 and the robot acts until the next echo. (J. Marsiano, Politecnico di Torino, 2022; its timer has a
    free length, here it is that of the agents.)
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self.latency_s = float("inf")
        self.heard_s = float("-inf")

    def heard(self, sent_s: float, arrived_s: float) -> None:
        """Keep the newest echo."""
        self.latency_s, self.heard_s = arrived_s - sent_s, arrived_s

    def silent(self, now_s: float) -> bool:
        """Return whether nothing has come for longer than the loss timeout."""
        return now_s - self.heard_s > self._settings.loss_timeout_s

    def place(self, now_s: float) -> Decision:
        """Decide by the thesis's rule."""
        if self.silent(now_s):
            return Decision(Site.ROBOT, "Silent", "No message for longer than the loss timeout")
        if self.latency_s > self._settings.allowed_loop_s:
            return Decision(Site.ROBOT, "LatencyTooHigh", "The newest message was over the threshold")
        return Decision(Site.CLOUD, "LinkGood", "The newest message was under the threshold")


class Dwell:
    """The same threshold, but after a change nothing changes for 20 s, except that silence ends a stay at once."""

    def __init__(self, settings: Settings) -> None:
        self._threshold = Threshold(settings)
        self._verdict = Decision(Site.ROBOT, "Starting", "The robot acts first")
        self._changed_s = float("-inf")

    def heard(self, sent_s: float, arrived_s: float) -> None:
        """Pass the echo on."""
        self._threshold.heard(sent_s, arrived_s)

    def place(self, now_s: float) -> Decision:
        """Return the threshold's answer if the dwell is over or nothing comes."""
        wanted = self._threshold.place(now_s)
        lost = wanted.site is Site.ROBOT and self._threshold.silent(now_s)
        if wanted.site is not self._verdict.site and (lost or now_s - self._changed_s >= DWELL_S):
            self._verdict, self._changed_s = wanted, now_s
        return self._verdict


class Mean:
    """The mean latency over a window of 3 s against the threshold; a loss is noticed after 10 s of silence.

    The window ends at the newest echo: while nothing comes the old mean holds. This is the rule of a well-known
    latency-aware offloading framework.
    """

    def __init__(self, settings: Settings) -> None:
        self._limit_s = settings.allowed_loop_s
        self._window: deque[tuple[float, float]] = deque()
        self._sum_s = 0.0

    def heard(self, sent_s: float, arrived_s: float) -> None:
        """Move the window."""
        self._window.append((arrived_s, arrived_s - sent_s))
        self._sum_s += arrived_s - sent_s
        while self._window[0][0] < arrived_s - WINDOW_S:
            self._sum_s -= self._window.popleft()[1]

    def place(self, now_s: float) -> Decision:
        """Decide by comparing the mean with the threshold."""
        if not self._window or now_s - self._window[-1][0] > WINDOW_LOSS_S:
            return Decision(Site.ROBOT, "Silent", "No message for longer than 10 s")
        if self._sum_s / len(self._window) > self._limit_s:
            return Decision(Site.ROBOT, "LatencyTooHigh", "The mean of the last 3 s was over the threshold")
        return Decision(Site.CLOUD, "LinkGood", "The mean of the last 3 s was under the threshold")
