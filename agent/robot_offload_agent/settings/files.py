"""Files that others read or write while the agent runs.

Never use them on a deciding thread: a disk may stall for longer than a lease lasts.
"""

from __future__ import annotations

import contextlib
import logging
import os
import threading
import time
from collections.abc import Callable
from pathlib import Path

from robot_offload_agent.runtime.guard import Guard

log = logging.getLogger(__name__)

WATCH_PERIOD_S = 0.1
"""A look at a file's identity takes some microseconds, and notices a mounted ConfigMap that exchanges its folder."""
GRAIN_S = 2.0
"""Two changes of a file may have the same time if they are closer than this: the coarsest file systems."""
TEXT_BYTES = 1 << 20
"""Longer files are not the agent's."""


def write_whole(path: Path, text: str, *, durable: bool = False) -> None:
    """Replace a file at once: a reader sees the old text or the new one.

    Args:
        path: its folder is made if it is missing.
        text: UTF-8.
        durable: return only when a loss of power cannot undo it.

    Raises:
        OSError: it could not be written; then the old text is still there.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f"{path.name}.part")
    with part.open("w", encoding="utf-8") as file:
        file.write(text)
        if durable:
            file.flush()
            os.fsync(file.fileno())
    part.replace(path)
    if durable:
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)


def read_text(path: Path) -> str:
    """Return the text of a file.

    Raises:
        OSError: it cannot be read.
        ValueError: it is not text, or longer than any file of the agent.
    """
    with path.open("rb") as file:
        data = file.read(TEXT_BYTES + 1)
    if len(data) > TEXT_BYTES:
        raise ValueError(f"more than {TEXT_BYTES} bytes")
    return data.decode()


class NewestWriter:
    """Writes the newest text on a thread of its own; an older text that is not written yet is skipped."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.text: str | None = None
        self.failed = False
        self.changed = threading.Event()
        threading.Thread(target=self._work, name="writer", daemon=True).start()

    def write(self, text: str) -> None:
        """Pass a text to the thread; return at once."""
        self.text = text
        self.changed.set()

    def _work(self) -> None:
        while self.changed.wait():
            self.changed.clear()
            try:
                write_whole(self.path, self.text or "")
            except OSError as error:
                if not self.failed:
                    log.warning("%s cannot be written: %s", self.path, error)
                self.failed = True
            else:
                self.failed = False


class Watch:
    """Calls back with the text of a file when it first exists and at each change, on its own thread.

    A mounted ConfigMap changes by exchanging a symbolic link: then the file behind the path is another one. A file
    written within the last look's grain of time is read again, because a further change would not show another time.
    """

    def __init__(self, path: Path, changed: Callable[[str | None, str], None]) -> None:
        """`changed(text, "")`, or `changed(None, why)` if the file cannot be read (any more)."""
        self.path = path
        self.changed = changed
        self.known: tuple[str | None, str] | None = None
        self.seen: tuple[int, ...] = ()
        self.guard = Guard()

    def start(self) -> None:
        """Begin to watch."""
        threading.Thread(target=self._work, name="watch", daemon=True).start()

    def look(self) -> None:
        """Look once, and read the file if it looks changed."""
        seen = _appearance(self.path)
        if seen and seen == self.seen:
            return
        self.seen = seen if age_s(self.path) > GRAIN_S else ()
        found: tuple[str | None, str]
        try:
            found = read_text(self.path), ""
        except (OSError, ValueError) as error:
            found = None, f"{self.path}: {getattr(error, 'strerror', None) or error}"
        if found != self.known:
            self.known = found
            self.changed(*found)

    def _work(self) -> None:
        while True:
            with self.guard:
                self.look()
            time.sleep(WATCH_PERIOD_S)


def _appearance(path: Path) -> tuple[int, ...]:
    """Return the identity of a file, which differs after a change; () if the file cannot be seen."""
    try:
        found = path.stat()
    except OSError:
        return ()
    return found.st_dev, found.st_ino, found.st_mtime_ns, found.st_ctime_ns, found.st_size


def age_s(path: Path) -> float:
    """Return how long ago a file was written, by this host's system clock; infinity if there is none."""
    with contextlib.suppress(OSError):
        return time.clock_gettime(time.CLOCK_REALTIME) - path.stat().st_mtime
    return float("inf")
