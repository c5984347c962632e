"""Starts the agent's processes, restarts them when they die or hang, and ends them all.

The processes are forked from here after the imports: they share the imported code's memory, and a dead one is back in
tens of milliseconds. The supervisor itself never opens ROS, Zenoh or a thread, so forking is safe at any time. When it
dies the others go on; the next supervisor ends those that are left and starts anew.

Every process gives signs of life (`beacon.py`). One that gives none is killed and restarted. The supervisor gives its
own to systemd, whose watchdog does the same with the whole agent.
"""

from __future__ import annotations

import contextlib
import fcntl
import gc
import logging
import os
import select
import signal
import socket
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TextIO

from robot_offload_agent.errors import AlreadyRunningError, ConfigurationError
from robot_offload_agent.runtime.bus import Bus
from robot_offload_agent.runtime.child import ENDING, Child, describe, run_child
from robot_offload_agent.runtime.clock import now_s
from robot_offload_agent.runtime.folder import prepare
from robot_offload_agent.runtime.identity import Holder, answer, end_holder, take
from robot_offload_agent.runtime.systemd import Systemd
from robot_offload_core.words.messages import Alive, Fatal, Lives, Unheard

log = logging.getLogger(__name__)

STOP_GRACE_S = 3.0
POLL_S = 0.02
IDLE_S = 0.5
"""Longest sleep; the death of a child and news end it. Signs of life are read then; each carries its age."""
START_S = 15.0
"""Until then a process in its first life may end the agent with a message; later that would end a working robot."""
LIVES_PERIOD_S = 1.0
UNHEARD_S = 1.4
"""A process silent for this long counts as hanging if another process also misses its messages: two witnesses."""
STRAY_PATIENCE_S = 3.0
"""Limit for the end of a killed process; one that waits for a broken disk does not end."""


@dataclass
class Supervisor:
    """The parent of one side's processes.

    Attributes:
        folder: runtime folder, accessible to its owner only.
        prefix: of the process names shown by ps, e.g. `ro-robot`.
        children: in start order; ended in reverse.
        identity: name that only one agent of this host can have, e.g. `wheelchair-robot`.
        flooded: the last turn read garbage.
    """

    folder: Path
    prefix: str
    children: list[Child]
    identity: str
    stopping: bool = False
    exit_code: int = 0
    started_s: float = 0.0
    turned_s: float = 0.0
    awake_s: float = 0.0
    flooded: bool = False
    lives_due_s: float = 0.0
    lock: TextIO | None = field(default=None, repr=False)
    name: socket.socket | None = field(default=None, repr=False)
    systemd: Systemd = field(default_factory=Systemd, repr=False)

    def run(self) -> int:
        """Run until a signal or a fatal message; return the exit code.

        Raises:
            AlreadyRunningError: another supervisor holds this identity on this host.
            ConfigurationError: the runtime folder cannot be used.
        """
        self._take_identity()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._stop)
        gc.freeze()  # keeps the collector from touching, and so copying, the pages shared with the children
        bus = self._bus()
        self.started_s = self.turned_s = now_s()
        wake, woken = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        signal.signal(signal.SIGCHLD, lambda *_: None)  # so that it reaches the pipe
        signal.set_wakeup_fd(woken, warn_on_full_buffer=False)
        try:
            while not self.stopping:
                self._turn(bus)
                self._sleep(bus, wake)
        finally:
            signal.set_wakeup_fd(-1)
            os.close(wake)
            os.close(woken)
            self.systemd.say("STOPPING=1")
            self._end_all()
            bus.close()
            for pattern in ("*.sock", "*.bell"):
                for path in self.folder.glob(pattern):
                    path.unlink(missing_ok=True)
        return self.exit_code

    def _turn(self, bus: Bus) -> None:
        now = now_s()
        # Time that the supervisor itself slept counts as no process's silence: a stopped supervisor or a frozen host
        # kills no process. Nor does time while garbage fills the inbox: signs of life that come meanwhile are dropped.
        if not self.flooded:
            self.awake_s += min(now - self.turned_s, 2 * IDLE_S)
        self.turned_s = now
        self._start_due()
        self._reap()
        garbage = bus.garbage
        self._read(bus)
        self.flooded = bus.garbage > garbage
        self._end_hanging()
        if now >= self.lives_due_s:
            self.lives_due_s = now + LIVES_PERIOD_S
            bus.send("control", Lives(tuple((c.name, c.deaths, c.hangs, c.broken) for c in self.children)))
        self.systemd.live(now)

    def _bus(self) -> Bus:
        try:
            return Bus(self.folder, "supervisor")
        except OSError as error:  # for example a path that is too long for a socket
            raise ConfigurationError(
                f"parameter runtime_dir: no socket can be made in {self.folder}: {error}"
            ) from error

    def _sleep(self, bus: Bus, wake: int) -> None:
        """Wait for a message, the death of a child, a signal, a question about the identity, or the next start."""
        assert self.name is not None
        due_s = min((child.start_due_s for child in self.children if not child.pid), default=float("inf"))
        sources: list[Any] = [bus.news, wake, self.name]
        select.select(sources, [], [], max(0.0, min(IDLE_S, due_s - self.awake_s)))
        with contextlib.suppress(BlockingIOError):
            os.read(wake, 4096)
        answer(self.name)

    # -- one of its kind ----------------------------------------------------------------------------------------------

    def _take_identity(self) -> None:
        """Take the identity, and end what its earlier supervisor has left."""
        try:
            taken = take(self.identity)
        except OSError as error:  # for example forbidden by a policy of the system
            raise ConfigurationError(
                f"parameter uid: the name {self.identity} cannot be taken on this host ({error}); without it nobody "
                "can say that this is the only agent of that identity: allow abstract unix sockets"
            ) from error
        if not isinstance(taken, socket.socket):
            raise AlreadyRunningError(self._refusal(taken))
        self.name = taken
        prepare(self.folder)
        try:
            self.lock = (self.folder / "lock").open("a")
        except OSError as error:
            raise ConfigurationError(
                f"parameter runtime_dir: {self.folder} cannot be used: {error.strerror}"
            ) from error
        try:
            fcntl.flock(self.lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise AlreadyRunningError(
                f"Another agent uses {self.folder} already (it holds the lock in it); stop it first, or give each "
                "agent its own runtime_dir"
            ) from error
        for child in self.children:
            stray = end_holder(f"{self.identity}/{child.name}", STRAY_PATIENCE_S)
            if stray is not None:
                raise AlreadyRunningError(self._refusal(stray))
        for pattern in ("*.pid", "*.memory"):  # of an earlier run; a memory outlives processes, not the whole agent
            for path in self.folder.glob(pattern):
                path.unlink(missing_ok=True)

    def _refusal(self, other: Holder) -> str:
        where = f"it is process {other.pid}" if other.pid else "it is in a container, or of another user"
        return (
            f"An agent of the identity {self.identity} runs on this host already: {where}; stop it first, or give each "
            "robot its own bundle"
        )

    # -- lives --------------------------------------------------------------------------------------------------------

    def _stop(self, *_: object) -> None:
        self.stopping = True

    def _start_due(self) -> None:
        for child in self.children:
            if not child.pid and self.awake_s >= child.start_due_s:
                self._fork(child)
        if self.lives_due_s == 0.0:
            self.systemd.say("READY=1", f"STATUS=Agent of {self.identity}")

    def _fork(self, child: Child) -> None:
        sys.stdout.flush()
        sys.stderr.flush()
        # A signal that reaches the child before it has its own handlers would be lost: see run_child.
        signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
        pid = os.fork()
        if pid:
            signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING)
            child.begin(pid, self.awake_s)
            path = self.folder / f"{child.name}.pid"
            try:
                path.write_text(str(pid))
            except OSError as error:  # only people read it
                log.warning("%s cannot be written: %s", path, error.strerror)
            return
        assert self.lock is not None
        assert self.name is not None
        self.lock.close()
        self.name.close()
        run_child(child, self.prefix, self.folder, self.identity)

    def _reap(self) -> None:
        for child in self.children:
            if not child.pid:
                continue
            pid, status = os.waitpid(child.pid, os.WNOHANG)
            if not pid:
                continue
            code = os.waitstatus_to_exitcode(status)
            wait_s = child.end(self.awake_s, code)
            if not self.stopping:
                log.error("Process %s ended with %s, starting it again in %.2f s", child.name, describe(code), wait_s)

    def _end_hanging(self) -> None:
        for child in self.children:
            if child.pid and child.silent_s(self.awake_s) > 0:
                self._end(child, child.hung_s)

    def _end(self, child: Child, silent_s: float) -> None:
        log.error("Process %s hangs (no sign of life for %g s), ending it", child.name, silent_s)
        child.give_up(self.awake_s)
        os.kill(child.pid, signal.SIGKILL)

    def _end_unheard(self, names: set[str]) -> None:
        """End processes that another process has not heard for too long, if they have shown no sign of life either."""
        for child in self.children:
            known = child.pid and not child.given_up and child.signed_s is not None
            if known and child.name in names and child.silent_s(self.awake_s) + child.hung_s >= UNHEARD_S:
                self._end(child, UNHEARD_S)

    def _read(self, bus: Bus) -> None:
        unheard = set()
        while (message := bus.receive()) is not None:
            if isinstance(message, Alive):
                self._sign(message)
            elif isinstance(message, Unheard):
                unheard |= {message.process} if message.silent_s >= UNHEARD_S else set()
            elif isinstance(message, Fatal) and not self.stopping:
                self._fail(message)
        self._end_unheard(unheard)

    def _sign(self, message: Alive) -> None:
        for child in self.children:
            if (child.name, child.pid) == (message.process, message.pid):
                child.sign(self.awake_s - message.age_s)

    def _fail(self, message: Fatal) -> None:
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
