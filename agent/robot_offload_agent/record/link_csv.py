"""Records the link as the robot's agent sees it: CSV `t_s,rtt_ms`, to be replayed by `robot-offload simulate --trace`.

Each echoed beat is a line, each other beat a line with an empty `rtt_ms`. Lines are collected and written once a
second. A full file is renamed to FILE.1 (the older one is deleted) and a new one begun, so that at most twice
`max_bytes` are used. A disk that is full or gone ends the recording, never the agent.
"""

from __future__ import annotations

import logging
from pathlib import Path

from robot_offload_core.link.links import Link

log = logging.getLogger(__name__)

HEADER = "t_s,rtt_ms\n"
MAX_BYTES = 16_000_000
"""About a quarter of a day of beats fills one file."""
FLUSH_S = 1.0
LOST_BEATS = 2.25
"""Fewer beat periods than this between two echoed beats are no loss: the cloud echoes only the newest beat it heard."""
LOST_ROWS = 50
"""Most lines for a long outage, evenly spread."""


class Recorder:
    """Records round trips.

    Args:
        file: to write; an older one becomes FILE.1.
        period_s: time between two beats.
        max_bytes: of one file.
    """

    def __init__(self, file: Path, period_s: float, max_bytes: int = MAX_BYTES) -> None:
        self.file, self.period_s, self.max_bytes = file, period_s, max_bytes
        self.ended = False
        self._lines: list[str] = []
        self._written = 0
        self._origin_s: float | None = None
        self._sent_s: float | None = None
        self._flushed_s = float("-inf")
        self._fresh = True

    def take(self, link: Link) -> None:
        """Take the link after a beat: a new echo is a new line."""
        sent_s, round_trip_s = link.echo_sent_s, link.round_trip_s
        if (
            self.ended
            or sent_s is None
            or round_trip_s is None
            or (self._sent_s is not None and sent_s <= self._sent_s)
        ):
            return
        if self._origin_s is None:
            self._origin_s = sent_s
        if self._sent_s is not None and sent_s - self._sent_s > LOST_BEATS * self.period_s:
            step_s = max(self.period_s, (sent_s - self._sent_s) / LOST_ROWS)
            lost_s = self._sent_s + step_s
            while lost_s < sent_s - step_s / 2:
                self._lines.append(f"{lost_s - self._origin_s:.4f},\n")
                lost_s += step_s
        self._lines.append(f"{sent_s - self._origin_s:.4f},{round_trip_s * 1e3:.2f}\n")
        self._sent_s = sent_s

    def flush(self, now_s: float) -> None:
        """Write what has been collected, once a second."""
        if self.ended or not self._lines or now_s - self._flushed_s < FLUSH_S:
            return
        self._flushed_s = now_s
        text = "".join(self._lines)
        self._lines = []
        try:
            self._write(text)
        except OSError as error:
            self.ended = True
            log.warning("RecordingEnded: %s cannot be written: %s; the agent goes on", self.file, error.strerror)

    def _write(self, text: str) -> None:
        if self._fresh or self._written + len(text) > self.max_bytes:
            if self.file.exists():
                self.file.replace(self.file.with_name(self.file.name + ".1"))
            text = HEADER + text
            self._written, self._fresh = 0, False
        with self.file.open("a", encoding="ascii") as out:
            out.write(text)
        self._written += len(text)
