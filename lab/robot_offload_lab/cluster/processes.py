"""The processes of one cluster: started so that none outlives its purpose, found again by the cluster's directory."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from robot_offload_lab.cluster.errors import ClusterError

_spawned: list[subprocess.Popen[bytes]] = []
"""Kept, because Python warns of a process object that is dropped; those that have ended are removed."""


_BOND = '[ "$PPID" = "$0" ] && exec "$@"'
"""The kernel informs a child of its parent's death only if the child asked before the parent died."""


def bond(die_with_us: bool) -> list[str]:
    """Return the prefix of a command that the kernel is to kill when the thread that starts it ends."""
    return ["setpriv", "--pdeathsig", "KILL", "sh", "-c", _BOND, str(os.getpid())] if die_with_us else []


def spawn(arguments: Sequence[str], log: Path, *, die_with_us: bool, favoured: bool = False) -> subprocess.Popen[bytes]:
    """Start a server with its output in a file.

    Args:
        arguments: Program and arguments. One of them must name the cluster's directory: it is how `running` finds it.
        log: Receives stdout and stderr.
        die_with_us: The kernel kills it when the *thread* that called this ends, however that happens.
        favoured: It gets ten times the processor share of other programs on a busy machine, where permitted.
    """
    with log.open("wb") as output:
        # A session of its own: Ctrl-C in the terminal reaches us, and we decide in which order things end.
        child = subprocess.Popen(
            [*bond(die_with_us), *arguments],
            env=without_proxies(os.environ),
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=output,
            start_new_session=True,
        )
    if favoured:
        # The scheduler divides a machine by session; `nice` has no effect between sessions.
        with suppress(OSError):
            Path(f"/proc/{child.pid}/autogroup").write_text("-10")
    _spawned[:] = [child, *(each for each in _spawned if each.poll() is None)]
    return child


def without_proxies(environment: Mapping[str, str]) -> dict[str, str]:
    """Return an environment without proxies, which do not know the cluster's addresses."""
    return {name: value for name, value in environment.items() if not name.lower().endswith("_proxy")}


def running(directory: Path) -> dict[int, str]:
    """Return process ids and names of the servers whose arguments name this cluster's directory."""
    found = {}
    needle = f"{directory}/".encode()
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit() or int(entry.name) == os.getpid():
            continue
        try:
            arguments = (entry / "cmdline").read_bytes().split(b"\0")
        except OSError:  # it has ended, or we may not read it
            continue
        # Only `--option=DIRECTORY/...` counts: an editor or a shell that has one of its files open is not a server.
        if any(argument.startswith(b"--") and b"=" + needle in argument for argument in arguments[1:]):
            found[int(entry.name)] = Path(os.fsdecode(arguments[0])).name
    return found


def kill(directory: Path, patience: float = 60.0) -> None:
    """Kill the servers of this cluster. Nothing is worth saving, and an orderly end of the API server takes seconds.

    Args:
        directory: The cluster's.
        patience: Seconds to wait until they are gone.
    """
    deadline = time.monotonic() + patience
    while pids := running(directory):
        for pid in pids:
            try:
                os.kill(pid, signal.SIGKILL)
            except ProcessLookupError:
                continue
        if time.monotonic() > deadline:
            raise ClusterError(f"These processes do not end: {pids}")
        time.sleep(0.02)


def free_ports(count: int) -> list[int]:
    """Return TCP ports of the loopback interface that no program uses at this moment."""
    sockets = [socket.socket() for _ in range(count)]
    try:
        for each in sockets:
            each.bind(("127.0.0.1", 0))
        return [each.getsockname()[1] for each in sockets]
    finally:
        for each in sockets:
            each.close()
