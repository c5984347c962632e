"""One supervised process: its life as the supervisor sees it, and its first actions after the fork."""

from __future__ import annotations

import contextlib
import logging
import os
import signal
import socket
import sys
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from robot_offload_agent.errors import AgentError
from robot_offload_agent.runtime import identity
from robot_offload_agent.runtime.bus import Bus
from robot_offload_core.words.checks import BROKEN_EXIT, InvariantError
from robot_offload_core.words.messages import Fatal

log = logging.getLogger(__name__)

HEALTHY_S = 10.0
"""A process that ran this long starts again at once when it dies; after quicker deaths it waits longer each time."""
RESTART_UNIT_S = 0.05
RESTART_MAX_S = 5.0
START_PATIENCE_S = 30.0
"""Limit for a process's first sign of life: joining a ROS graph through a distant server takes seconds."""
HUNG_S = 6.0
"""A process without a sign of life for this long hangs: 12 signs are missing. A busy machine delays one by less."""

ENDING = (signal.SIGINT, signal.SIGTERM)
"""Signals that end a process; blocked between the fork and the handlers of the child, so that none is lost."""

Run = Callable[[], None]


@dataclass
class Child:
    """One supervised process. Times are of the supervisor's clock, which stands still while the supervisor does.

    Attributes:
        name: also of its socket, of its pid file, and the end of the name that ps shows.
        run: its task.
        hung_s: silence after which it counts as hanging.
        pid: 0 while it is dead.
        starts, deaths, hangs: how often it started, died by itself, and was ended because it hung.
        broken: how many of the deaths were for a broken invariant.
        started_s, start_due_s: of its present or next life.
        signed_s: its last sign of life, None before the first one of a life.
        given_up: it hung in this life and is being killed; its further signs do not count.
        quick_deaths: in a row.
    """

    name: str
    run: Run
    hung_s: float = HUNG_S
    pid: int = 0
    starts: int = 0
    deaths: int = 0
    hangs: int = 0
    broken: int = 0
    started_s: float = 0.0
    start_due_s: float = 0.0
    signed_s: float | None = None
    given_up: bool = False
    quick_deaths: int = 0

    def begin(self, pid: int, now_s: float) -> None:
        """Begin a life."""
        self.pid, self.started_s, self.signed_s, self.starts = pid, now_s, None, self.starts + 1
        self.given_up = False

    def sign(self, now_s: float) -> None:
        """Record a sign of life of the process."""
        if not self.given_up:
            self.signed_s = now_s

    def end(self, now_s: float, code: int) -> float:
        """End a life with an exit code; return the seconds until the next one begins."""
        self.broken += code == BROKEN_EXIT
        self.quick_deaths = 0 if now_s - self.started_s >= HEALTHY_S else self.quick_deaths + 1
        wait_s = min(RESTART_MAX_S, RESTART_UNIT_S * 2 ** (self.quick_deaths - 2)) if self.quick_deaths > 1 else 0.0
        self.pid, self.start_due_s, self.deaths = 0, now_s + wait_s, self.deaths + 1
        return wait_s

    def give_up(self, now_s: float) -> None:
        """Record that the process hangs and is being killed; if it lives on, it is killed again after the same wait."""
        self.hangs += not self.given_up
        self.given_up, self.signed_s = True, now_s

    def silent_s(self, now_s: float) -> float:
        """Return by how many seconds the process has exceeded its allowed silence; negative while all is well."""
        if self.signed_s is None:
            return now_s - self.started_s - START_PATIENCE_S
        return now_s - self.signed_s - self.hung_s


def run_child(child: Child, prefix: str, folder: Path, name: str) -> None:
    """Run a forked process and never return. `name` is the agent's identity."""
    signal.set_wakeup_fd(-1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the terminal's Ctrl-C reaches all; the supervisor ends us in order
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING)
    with contextlib.suppress(OSError):
        Path("/proc/self/comm").write_text(f"{prefix}-{child.name}"[:15])
    _held = _named(f"{name}/{child.name}")  # for as long as this process lives
    code = 1
    try:
        child.run()
        code = 0
    except AgentError as error:
        code = error.exit_code
        Bus(folder, f"{child.name}.end").send("supervisor", Fatal(child.name, str(error), code))
    except BaseException as error:
        code = BROKEN_EXIT if isinstance(error, InvariantError) else 1
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _named(name: str) -> socket.socket | None:
    """Take a name by which the next supervisor finds this process after its own is gone; nothing else depends on it."""
    try:
        held = identity.take(name)
    except OSError as error:
        log.warning("The name %s cannot be taken: %s; a later supervisor cannot find this process", name, error)
        return None
    if isinstance(held, socket.socket):
        return held
    log.warning("Process %d holds the name %s; a later supervisor cannot find this process", held.pid, name)
    return None


def describe(code: int) -> str:
    """Return an exit code in words."""
    return f"signal {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
