"""Starts the agent's processes, starts them again when they die, and ends them all.

The processes are forked from here after the imports: they share the imported code's memory, and a dead one is back in
tens of milliseconds. The supervisor itself never opens ROS, Zenoh or a thread, so forking is safe at any time. When it
dies the others go on; the next supervisor ends those that are left and starts anew.
"""

from __future__ import annotations

import contextlib
import fcntl
import gc
import logging
import os
import select
import signal
import sys
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TextIO

from robot_offload_agent.errors import AgentError, AlreadyRunningError, ConfigurationError
from robot_offload_agent.process.bus import Bus
from robot_offload_agent.process.clock import now_s
from robot_offload_core.process.messages import Fatal

log = logging.getLogger(__name__)

RESTART_FIRST_S = 0.0
RESTART_MAX_S = 5.0
HEALTHY_S = 10.0
"""A process that ran for this long starts again at once when it dies; quicker deaths wait longer each time."""
STOP_GRACE_S = 3.0
POLL_S = 0.02
IDLE_S = 1.0
"""Longest sleep; the death of a child and messages end it."""
START_S = 15.0
"""In this time a process in its first life may end the agent with a message; later that would end a working robot."""

Run = Callable[[], None]


@dataclass
class Child:
    """One supervised process."""

    name: str
    run: Run
    pid: int = 0
    starts: int = 0
    started_s: float = 0.0
    start_due_s: float = 0.0
    quick_deaths: int = 0


@dataclass
class Supervisor:
    """The parent of one side's processes.

    Attributes:
        folder: runtime folder, made with access for its owner only.
        prefix: of the process names shown by ps, e.g. `ro-robot`.
        children: in start order; ended in reverse.
    """

    folder: Path
    prefix: str
    children: list[Child]
    stopping: bool = False
    exit_code: int = 0
    started_s: float = 0.0
    lock: TextIO | None = field(default=None, repr=False)

    def run(self) -> int:
        """Runs until a signal or a fatal message; returns the exit code.

        Raises:
            AlreadyRunningError: another supervisor holds this identity on this host.
        """
        self._take_identity()
        for name in (signal.SIGINT, signal.SIGTERM):
            signal.signal(name, self._stop)
        gc.freeze()  # keeps the collector from touching, and so copying, the pages shared with the children
        bus = self._bus()
        self.started_s = now_s()
        wake, woken = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        signal.signal(signal.SIGCHLD, lambda *_: None)  # so that it reaches the pipe
        signal.set_wakeup_fd(woken, warn_on_full_buffer=False)
        try:
            while not self.stopping:
                self._start_due()
                self._reap()
                self._read(bus)
                self._sleep(bus, wake)
        finally:
            signal.set_wakeup_fd(-1)
            os.close(wake)
            os.close(woken)
            self._end_all()
            bus.close()
            for path in self.folder.glob("*.sock"):
                path.unlink(missing_ok=True)
        return self.exit_code

    def _bus(self) -> Bus:
        try:
            return Bus(self.folder, "supervisor")
        except OSError as error:  # for example a path that is too long for a socket
            raise ConfigurationError(
                f"parameter runtime_dir: no socket can be made in {self.folder}: {error}"
            ) from error

    def _sleep(self, bus: Bus, wake: int) -> None:
        """Until a message, the death of a child, a signal, or the time to start a process again."""
        due_s = min((child.start_due_s for child in self.children if not child.pid), default=now_s() + IDLE_S)
        sources: list[Any] = [bus, wake]
        select.select(sources, [], [], max(0.0, min(IDLE_S, due_s - now_s())))
        with contextlib.suppress(BlockingIOError):
            os.read(wake, 4096)

    def _take_identity(self) -> None:
        try:
            self.folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            self.lock = (self.folder / "lock").open("a")
        except OSError as error:
            raise ConfigurationError(
                f"parameter runtime_dir: {self.folder} cannot be used: {error.strerror}"
            ) from error
        try:
            fcntl.flock(self.lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            self.lock.close()
            raise AlreadyRunningError(
                f"An agent with this identity runs on this host already (it holds {self.folder}/lock); "
                "stop it first, or give each robot its own bundle"
            ) from error
        for path in self.folder.glob("*.pid"):
            end_stray(path, self.prefix)
        for path in self.folder.glob("*.memory"):
            path.unlink()  # of an earlier run; a memory outlives processes, not the whole agent

    def _stop(self, *_: object) -> None:
        self.stopping = True

    def _start_due(self) -> None:
        for child in self.children:
            if not child.pid and now_s() >= child.start_due_s:
                self._fork(child)

    def _fork(self, child: Child) -> None:
        sys.stdout.flush()
        sys.stderr.flush()
        pid = os.fork()
        if pid:
            child.pid, child.started_s, child.starts = pid, now_s(), child.starts + 1
            (self.folder / f"{child.name}.pid").write_text(str(pid))
            return
        assert self.lock is not None
        self.lock.close()
        run_child(child, self.prefix, self.folder)

    def _reap(self) -> None:
        for child in self.children:
            if not child.pid:
                continue
            pid, status = os.waitpid(child.pid, os.WNOHANG)
            if not pid:
                continue
            now, code = now_s(), os.waitstatus_to_exitcode(status)
            child.quick_deaths = 0 if now - child.started_s >= HEALTHY_S else child.quick_deaths + 1
            wait_s = min(RESTART_MAX_S, 0.05 * 2 ** (child.quick_deaths - 2)) if child.quick_deaths > 1 else 0.0
            child.pid, child.start_due_s = 0, now + wait_s
            if not self.stopping:
                log.error("Process %s ended with %s, starting it again in %.2f s", child.name, describe(code), wait_s)

    def _read(self, bus: Bus) -> None:
        while (message := bus.receive()) is not None:
            if not isinstance(message, Fatal) or self.stopping:
                continue
            log.error("%s: %s", message.process, message.message)
            again = any(child.name == message.process and child.starts > 1 for child in self.children)
            if now_s() - self.started_s < START_S and not again:
                self.exit_code, self.stopping = message.exit_code, True

    def _end_all(self) -> None:
        for child in reversed(self.children):
            if child.pid:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(child.pid, signal.SIGTERM)
                    os.kill(child.pid, signal.SIGCONT)
        deadline_s = now_s() + STOP_GRACE_S
        while any(child.pid for child in self.children):
            self._reap()
            if now_s() > deadline_s:  # rclpy can swallow SIGTERM in a process that hangs
                for child in self.children:
                    if child.pid:
                        os.kill(child.pid, signal.SIGKILL)
            time.sleep(POLL_S)
        for child in self.children:
            (self.folder / f"{child.name}.pid").unlink(missing_ok=True)


def run_child(child: Child, prefix: str, folder: Path) -> None:
    """What a forked process does; never returns."""
    signal.set_wakeup_fd(-1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the terminal's Ctrl-C reaches all; the supervisor ends us in order
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    with contextlib.suppress(OSError):
        Path("/proc/self/comm").write_text(f"{prefix}-{child.name}"[:15])
    code = 1
    try:
        child.run()
        code = 0
    except AgentError as error:
        code = error.exit_code
        Bus(folder, f"{child.name}.end").send("supervisor", Fatal(child.name, str(error), code))
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def end_stray(path: Path, prefix: str) -> None:
    """Ends a process that a dead supervisor left behind; a reused pid of somebody else is left alone."""
    try:
        pid = int(path.read_text())
        comm = Path(f"/proc/{pid}/comm").read_text().strip()
    except (OSError, ValueError):
        path.unlink(missing_ok=True)
        return
    if comm == f"{prefix}-{path.stem}"[:15]:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    path.unlink(missing_ok=True)


def describe(code: int) -> str:
    """An exit code in words."""
    return f"signal {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
