"""Finding and ending every process of one run, whatever started it: the run's mark is in its environment.

A process inherits its environment, so the mark reaches children of children and daemons that have left their group.
Also a program, the run's warden: `python -m robot_offload_lab.run.marked RUN [FOLDER]` waits until its standard input
ends, then ends what carries the mark and removes the folder. However its parent dies, the kernel closes that input.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path

MARK = "ROBOT_OFFLOAD_RUN"
"""The environment variable; its value names the run."""
GRACE_S = 3.0
"""How long processes may take to end by themselves: the agent's supervisor needs up to 3 s for its children."""
KILL_S = 5.0
"""How long the kernel may take to end killed processes."""
_LOOK_S = 0.05


def find(run: str, mark: str = MARK) -> tuple[int, ...]:
    """Return the living processes that carry the mark of a run, without this one.

    Args:
        run: its name.
        mark: the environment variable; another than `MARK` if the marked processes mark children of their own.
    """
    wanted = f"{mark}={run}".encode()
    found = []
    for folder in Path("/proc").iterdir():
        # A process may end meanwhile; the environments of other users' processes may not be read.
        with suppress(OSError):
            if folder.name.isdigit() and wanted in (folder / "environ").read_bytes().split(b"\0"):
                found.append(int(folder.name))
    return tuple(pid for pid in found if pid != os.getpid())


def named(pids: Iterable[int]) -> list[str]:
    """Return each process's number and command line, so that people can find out what was left behind."""
    return [f"{pid}: {_command(pid)}" for pid in pids]


def _command(pid: int) -> str:
    with suppress(OSError):  # it may have ended
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace").strip()
    return "has ended"


def end(run: str, grace_s: float = GRACE_S) -> None:
    """End the processes of a run: ask them, wait, then kill, until none is left or the kernel gives none up."""
    _signal(run, signal.SIGTERM)
    _signal(run, signal.SIGCONT)  # a stopped process could not obey
    asked_s = time.monotonic()
    while find(run) and time.monotonic() < asked_s + grace_s + KILL_S:
        if time.monotonic() > asked_s + grace_s:
            _signal(run, signal.SIGKILL)
        time.sleep(_LOOK_S)


def start_warden(run: str, *folders: Path) -> subprocess.Popen[bytes]:
    """Start the warden of a run; it removes these folders at the end."""
    command = [sys.executable, "-m", "robot_offload_lab.run.marked", run, *map(str, folders)]
    silent = subprocess.DEVNULL
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=silent, stderr=silent, start_new_session=True)


def dismiss(warden: subprocess.Popen[bytes]) -> None:
    """Let a warden do its work now, and wait for it."""
    if warden.stdin is not None:
        warden.stdin.close()
    warden.wait()


def _signal(run: str, number: signal.Signals) -> None:
    for pid in find(run):
        with suppress(ProcessLookupError):
            os.kill(pid, number)


def main(arguments: Sequence[str]) -> int:
    """Return the warden."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    while sys.stdin.buffer.read(1024):
        pass
    run, *folders = arguments
    end(run)
    for folder in folders:
        shutil.rmtree(folder, ignore_errors=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
