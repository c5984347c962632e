"""Child processes of one run that never outlive it.

Three safety nets: leaving `Processes` ends every group it has started; a warden process (see `marked`) does the same
when this process is killed; and the kernel ends each child that has lost its parent. So exceptions, Ctrl-C, SIGTERM, a
closed terminal or `kill -9` leave nothing behind.
"""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

from robot_offload.errors import RobotOffloadError
from robot_offload_lab.run import marked

_PR_SET_PDEATHSIG = 1
"""From <sys/prctl.h>: the signal that this process gets when its parent ends."""
_LOOK_S = 0.02
_LAST_LINES = 12
_MAX_TAIL_BYTES = 16384
_libc = ctypes.CDLL(None, use_errno=True)


class ProcessError(RobotOffloadError):
    """A process could not start or ended when it should not."""


@dataclass(frozen=True)
class Program:
    """What to start.

    Attributes:
        name: for people; also the name of its log file.
        command: program and arguments.
        folder: its working directory.
        environment: all its variables.
        piped: its standard input and output are pipes to us; otherwise its output goes to the log.
        priority: under SCHED_FIFO; 0: a normal process. Where that is not permitted it runs as a normal one.
    """

    name: str
    command: tuple[str, ...]
    folder: Path
    environment: Mapping[str, str]
    piped: bool = False
    priority: int = 0


@dataclass(frozen=True)
class Ended:
    """A process that ended by itself.

    Attributes:
        code: exit code; negative: the signal that ended it.
        log: where it wrote.
    """

    name: str
    code: int
    log: Path

    def describe(self) -> str:
        """Return how it ended, in words."""
        how = f"by signal {signal.Signals(-self.code).name}" if self.code < 0 else f"with exit code {self.code}"
        return f"{self.name} ended {how}"


class Processes:
    """Starts programs, each in its own session and process group, and ends all of them on exit."""

    def __init__(self, run: str, logs: Path, temporary: Path) -> None:
        """Prepare; start nothing.

        Args:
            run: marks the environment of all processes of this run.
            logs: folder of the log files, which must exist.
            temporary: folder that the warden removes if this process dies.
        """
        self._run = run
        self._logs = logs
        self._temporary = temporary
        self._children: dict[str, subprocess.Popen[bytes]] = {}
        self._warden: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Self:
        self._warden = marked.start_warden(self._run, self._temporary)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def start(self, program: Program) -> subprocess.Popen[bytes]:
        """Start a program.

        Raises:
            ProcessError: there is no such program, or it may not be run.
        """
        environment = {**program.environment, marked.MARK: self._run}
        pipe = subprocess.PIPE if program.piped else None
        with self.log(program.name).open("ab") as log:
            try:
                child = subprocess.Popen(
                    program.command,
                    cwd=program.folder,
                    env=environment,
                    stdin=pipe or subprocess.DEVNULL,
                    stdout=pipe or log,
                    stderr=log,
                    start_new_session=True,
                    preexec_fn=_end_with_parent,  # noqa: PLW1509 - this process has no other threads
                )
            except OSError as error:
                raise ProcessError(
                    f"{program.name}: {program.command[0]} cannot be started: {error.strerror}; is it installed?"
                ) from error
        if program.priority:
            # Its threads will inherit it; right after the start it has none yet.
            with suppress(PermissionError, ProcessLookupError):
                os.sched_setscheduler(child.pid, os.SCHED_FIFO, os.sched_param(program.priority))
        self._children[program.name] = child
        return child

    def log(self, name: str) -> Path:
        """Return where a program writes."""
        return self._logs / f"{name}.log"

    def last_lines(self, name: str) -> tuple[str, ...]:
        """Return the end of a program's log."""
        try:
            text = self.log(name).read_bytes()[-_MAX_TAIL_BYTES:].decode(errors="replace")
        except OSError:
            return ()
        return tuple(line for line in text.splitlines() if line.strip())[-_LAST_LINES:]

    def first_ended(self) -> Ended | None:
        """Return a process that ended without being stopped; None while all run."""
        for name, child in self._children.items():
            code = child.poll()
            if code is not None:
                return Ended(name, code, self.log(name))
        return None

    def end(self, name: str, grace_s: float) -> None:
        """Ask a program to end by SIGTERM, and kill it after `grace_s`; forget it."""
        _signal_group(self._children[name], signal.SIGTERM)
        self.finish(name, grace_s)

    def finish(self, name: str, grace_s: float) -> None:
        """Wait until a program that was asked to end has ended, and kill it if it does not; forget it."""
        child = self._children.pop(name)
        try:
            child.wait(grace_s)
        except subprocess.TimeoutExpired:
            _signal_group(child, signal.SIGKILL)
            child.wait()
        _close_pipes(child)

    def stop(self) -> None:
        """End all, and return when none is left; may be called at any time."""
        children = list(self._children.values())
        for child in children:
            _signal_group(child, signal.SIGTERM)
            _signal_group(child, signal.SIGCONT)
        deadline_s = time.monotonic() + marked.GRACE_S
        while any(child.poll() is None for child in children) and time.monotonic() < deadline_s:
            time.sleep(_LOOK_S)
        for child in children:
            _signal_group(child, signal.SIGKILL)  # also for what a child that has ended left in its group
            child.wait()
            _close_pipes(child)
        self._children.clear()
        marked.end(self._run, grace_s=0.0)  # what has left its group
        if self._warden is not None:
            marked.dismiss(self._warden)
            self._warden = None


def _end_with_parent() -> None:
    """Run in the child before the program: have the kernel end it when its parent dies."""
    _libc.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)


def _signal_group(child: subprocess.Popen[bytes], number: signal.Signals) -> None:
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(child.pid, number)


def _close_pipes(child: subprocess.Popen[bytes]) -> None:
    for pipe in (child.stdin, child.stdout):
        if pipe is not None:
            with suppress(OSError):
                pipe.close()
