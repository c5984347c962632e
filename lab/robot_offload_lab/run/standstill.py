"""Whether this machine stood still during a run: then silence and switches prove nothing about link or agents."""

from __future__ import annotations

import json
import select
import subprocess
import sys
import time
from collections.abc import Callable
from types import TracebackType
from typing import Self

from robot_offload_lab.run import realtime

STEP_S = 0.01
STOOD_S = 0.1
"""A sleep of STEP_S that ends this much late is a standstill: six of the agents' turns."""


class Standstill:
    """A process that only compares two clocks for as long as the context lasts.

    A thread of the demo would wait for the demo's other threads, and those for the processes of the run.

    Attributes:
        lengths_s: by how much each sleep that took too long exceeded its time.
        suspended_s: how long the machine was suspended: only the clock that includes suspension went on.
    """

    def __init__(
        self,
        running_s: Callable[[], float] = time.monotonic,
        passing_s: Callable[[], float] = lambda: time.clock_gettime(time.CLOCK_BOOTTIME),
    ) -> None:
        self.running_s, self.passing_s = running_s, passing_s
        self.lengths_s: list[float] = []
        self.suspended_s = 0.0
        self._last = running_s(), passing_s()
        self._process: subprocess.Popen[str] | None = None

    def __enter__(self) -> Self:
        command = [sys.executable, "-m", __name__]
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True
        )
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        assert self._process is not None
        said, _ = self._process.communicate()
        if said:
            found = json.loads(said)
            self.lengths_s, self.suspended_s = found["lengths_s"], found["suspended_s"]

    def look(self) -> None:
        """Compare both clocks with the last look."""
        before, self._last = self._last, (self.running_s(), self.passing_s())
        ran_s, passed_s = self._last[0] - before[0], self._last[1] - before[1]
        self.suspended_s += max(0.0, passed_s - ran_s - STOOD_S)
        if passed_s - STEP_S > STOOD_S:
            self.lengths_s.append(passed_s - STEP_S)

    def sentence(self) -> str:
        """Return a sentence for people; "" when the machine ran all the time."""
        if not self.lengths_s:
            return ""
        times = "once" if len(self.lengths_s) == 1 else f"{len(self.lengths_s)} times"
        text = f"This machine stood still {times}, for up to {max(self.lengths_s) * 1e3:.0f} ms"
        if self.suspended_s:
            text += f" ({self.suspended_s:.1f} s of it suspended)"
        return f"{text}: silence, alarms and switches then are the machine's, not the link's; try again with less load"


def watch() -> None:
    """Watch until standard input ends, then print what was found as JSON."""
    realtime.take(realtime.HIGHEST_PRIORITY)  # otherwise the processes of the run could delay it
    found = Standstill()
    while not select.select([sys.stdin], [], [], STEP_S)[0]:
        found.look()
    print(json.dumps({"lengths_s": found.lengths_s, "suspended_s": found.suspended_s}))  # noqa: T201 - what it is for


if __name__ == "__main__":
    watch()
