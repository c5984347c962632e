"""The folder of recordings: each is first written under another name, the oldest go, and the disk keeps some room."""

from __future__ import annotations

import contextlib
import errno
import os
import re
import shutil
import time
from collections.abc import Iterator
from pathlib import Path

from robot_offload_agent.record.mcap.mcap_file import McapFile
from robot_offload_agent.record.mcap.ring import Changeover, Window

RESERVE_BYTES = 64 << 20
"""Free room that a recording leaves on the disk: settings and certificates must fit there, too."""
PART = ".part"


class Kept:
    """Recordings of one agent in a folder that others may use as well.

    Args:
        folder: made if it is missing.
        keep: number of recordings that stay in it, whichever agent wrote them.
        release: of the agent.
        uid: its identity, part of the names.
    """

    def __init__(self, folder: Path, keep: int, release: str, uid: str) -> None:
        self.folder, self.keep, self.release, self.uid = folder, keep, release, uid

    def write(self, window: Window) -> Path:
        """Write a window; return the file.

        Raises:
            OSError: the disk is full, gone, or cannot be written; nothing of the file is left.
            StartError: mcap is not installed, or the type of a message.
        """
        self.folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        self._clear()
        size = sum(entry.size for entry in window.entries)
        if shutil.disk_usage(self.folder).free < size + RESERVE_BYTES:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        file = self.folder / self._name(window.changeover)
        part = file.with_name(file.name + PART)
        try:
            with part.open("xb") as stream:
                written = McapFile(stream, self.release)
                written.describe(_facts(window))
                for entry in window.entries:
                    written.write(entry)
                written.finish()
            part.replace(file)
        except BaseException:
            with contextlib.suppress(OSError):
                part.unlink()
            raise
        self._prune()
        return file

    def _name(self, changeover: Changeover) -> str:
        seconds, rest = divmod(changeover.stamp_ns, 1_000_000_000)
        at = time.strftime("%Y%m%dT%H%M%S", time.gmtime(seconds))
        return f"switch-{at}.{rest // 1_000_000:03d}Z-{changeover.site}-{changeover.epoch}-{self.uid}.mcap"

    def _clear(self) -> None:
        """Remove unfinished files of an earlier process of this agent."""
        for part in self.folder.glob(f"switch-*-{self.uid}.mcap{PART}"):
            part.unlink(missing_ok=True)

    def _prune(self) -> None:
        files = list(recordings(self.folder))
        for old in files[: max(0, len(files) - self.keep)]:
            old.unlink(missing_ok=True)


def recordings(folder: Path) -> Iterator[Path]:
    """Yield the recordings in a folder, the oldest first."""
    found = (file for file in folder.glob("switch-*.mcap") if re.match(r"switch-\d{8}T", file.name))
    yield from sorted(found)


def _facts(window: Window) -> dict[str, str]:
    changeover = window.changeover
    return {
        "what": "changeover", "to": changeover.site, "epoch": str(changeover.epoch), "reason": changeover.reason,
        "at_ns": str(changeover.stamp_ns), "cut": str(window.cut).lower(),
    }  # fmt: skip
