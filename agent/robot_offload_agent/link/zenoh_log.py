"""Parse Zenoh's log, the only place that states why a session was refused.

The wheel writes its log to the standard output of the process, past Python. So that file descriptor becomes a pipe that
is read here. Nothing else in the agent's processes writes to it.
"""

from __future__ import annotations

import logging
import os
import sys
import threading
from collections import deque
from collections.abc import Callable

import zenoh

from robot_offload_agent.link.zenoh_causes import Found, read_line
from robot_offload_agent.runtime.clock import now_s

log = logging.getLogger(__name__)

_KEPT = 64
_STDOUT = 1


class WheelLog:
    """Reads the wheel's log from construction to `close`; one a process."""

    def __init__(self) -> None:
        """Begin to read."""
        self._change = threading.Condition()
        self._dialled: deque[tuple[float, Found]] = deque(maxlen=_KEPT)
        self._watchers: list[Callable[[Found], None]] = []
        # A user who sets the level wants to see the lines.
        self._shown = "RUST_LOG" in os.environ
        reading, writing = os.pipe()
        os.set_blocking(writing, False)  # a thread of the wheel must never wait for us
        sys.stdout.flush()
        self._before = os.dup(_STDOUT)
        os.dup2(writing, _STDOUT)
        os.close(writing)
        zenoh.init_log_from_env_or("warn")
        self._thread = threading.Thread(target=self._read, args=(reading,), name="wheel-log", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Give the standard output back and wait until all lines are read."""
        os.dup2(self._before, _STDOUT)
        os.close(self._before)
        self._thread.join()

    def watch(self, watcher: Callable[[Found], None]) -> None:
        """Call `watcher` on a thread of its own for what happens at listeners from now on."""
        self._watchers.append(watcher)

    def dialled(self, endpoints: tuple[str, ...], since_s: float, wait_s: float) -> list[Found]:
        """Return the wheel's lines about these endpoints since then; wait for the first such line for `wait_s`."""

        def said() -> list[Found]:
            return [found for t_s, found in self._dialled if t_s >= since_s and found.endpoint in endpoints]

        with self._change:
            self._change.wait_for(said, wait_s)
            return said()

    def _read(self, descriptor: int) -> None:
        with os.fdopen(descriptor, encoding="utf-8", errors="replace") as lines:
            for line in lines:
                if self._shown:
                    sys.stderr.write(line)
                found = read_line(line)
                if found is None:
                    log.debug("The wheel: %s", line.rstrip())
                elif found.endpoint:
                    with self._change:
                        self._dialled.append((now_s(), found))
                        self._change.notify_all()
                else:
                    for watcher in self._watchers:
                        watcher(found)
