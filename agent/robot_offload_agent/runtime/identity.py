"""One agent per identity and host, whatever its folder, its user or its container.

An identity is the name of an abstract unix socket. The kernel keeps such names for each network namespace, so
containers on the host's network share them, and frees a name when its holder dies. A connection shows who listens
(`SO_PEERCRED`), so no number in a file, of an earlier boot or of a dead process, has to be trusted.
"""

from __future__ import annotations

import contextlib
import errno
import os
import signal
import socket
import struct
import time
from dataclasses import dataclass

_PREFIX = "\0robot-offload/"
_BACKLOG = 128
"""Connections that may wait; they need no answer, because the kernel has given it."""
_CREDENTIALS = struct.Struct("3i")
_POLL_S = 0.01


@dataclass(frozen=True)
class Holder:
    """The process that holds a name.

    Attributes:
        pid: process id; 0 if it lives in a container whose processes cannot be seen from here.
        user: user id; -1 if it is not known.
    """

    pid: int
    user: int = -1


def take(name: str) -> socket.socket | Holder:
    """Take a name for as long as the returned socket, or a copy of it in another process, is open.

    Return the holder instead if another process has the name.

    Raises:
        OSError: this process may take no such name at all.
    """
    taken = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK)
    try:
        taken.bind(_PREFIX + name)
    except OSError as error:
        taken.close()
        if error.errno != errno.EADDRINUSE:
            raise
        return holder(name) or Holder(0)
    taken.listen(_BACKLOG)
    return taken


def holder(name: str) -> Holder | None:
    """Return the holder of a name, or None."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK) as asking:
        try:
            asking.connect(_PREFIX + name)
        except ConnectionRefusedError:
            return None
        except OSError:  # more questions wait than the holder has read: somebody is there
            return Holder(0)
        pid, user, _ = _CREDENTIALS.unpack(asking.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size))
    return Holder(pid, user)


def answer(taken: socket.socket) -> None:
    """End the connections of those who asked, so that the next ones can ask as well."""
    with contextlib.suppress(BlockingIOError):
        while True:
            taken.accept()[0].close()


def end_holder(name: str, patience_s: float) -> Holder | None:
    """End a process of an earlier agent of this user that still holds a name; return it if it cannot be ended.

    Processes of other users are left alone. `patience_s` bounds the wait for its end.
    """
    end_s = time.monotonic() + patience_s
    while (found := holder(name)) is not None:
        if not found.pid or found.user != os.geteuid() or time.monotonic() > end_s:
            return found
        with contextlib.suppress(ProcessLookupError):
            process = os.pidfd_open(found.pid)
            try:
                if holder(name) == found:  # else the process ended, and its number may be somebody else's now
                    signal.pidfd_send_signal(process, signal.SIGKILL)
            finally:
                os.close(process)
        time.sleep(_POLL_S)
    return None
