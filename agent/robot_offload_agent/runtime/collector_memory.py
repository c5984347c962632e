"""What the collector has reached, in a file of the runtime folder: for its next life, and for whoever asks who holds.

The file is one line of words with a checksum in front. Another process may read while the collector writes, so a reader
takes what is whole only.
"""

from __future__ import annotations

import logging
import mmap
import os
import zlib
from pathlib import Path

from robot_offload_core.collector.state import Collector
from robot_offload_core.words.gates import Charge
from robot_offload_core.words.holding import Holding
from robot_offload_core.words.token import Site, Token

log = logging.getLogger(__name__)

FILE_NAME = "collector.memory"
MEMORY_BYTES = 256
READS = 10
"""Tries of one look: a write takes less than a microsecond, so the second is whole unless the writer died in it."""
NOBODY = Holding(Site.ROBOT, 0, Token("", 0, ""))
"""Before the first gate the collector passes the robot."""


class Memory:
    """The charge reached so far; the collector's end of the file."""

    def __init__(self, folder: Path) -> None:
        path = folder / FILE_NAME
        fresh = not path.exists()
        try:
            with path.open("a+b") as file:
                os.posix_fallocate(file.fileno(), 0, MEMORY_BYTES)  # else a page missing later would kill us
                self.map = mmap.mmap(file.fileno(), MEMORY_BYTES)
        except OSError as error:
            log.warning("%s cannot be written: %s; a collector that is started again waits for control", path, error)
            self.map, fresh = mmap.mmap(-1, MEMORY_BYTES), True
        if fresh:
            self.map[:] = bytes(MEMORY_BYTES)

    def save(self, state: Collector) -> None:
        """Write who passes now."""
        if state.charge is None:
            return
        token = state.charge.token
        words = [state.charge.site.value, token.robot, str(token.epoch), token.cloud or "-"]
        text = " ".join([*words, str(state.started_us), str(int(state.fell_back)), str(state.stay)])
        self.map[:] = f"{zlib.crc32(text.encode()):08x} {text}".encode().ljust(MEMORY_BYTES, b"\0")

    def load(self) -> tuple[Charge, int, bool, int] | None:
        """Return (charge, started_us, fell_back, stay); None when nothing whole is there."""
        return _read(self.map)


class HolderView:
    """Who holds, as another process reads it from the collector's memory; cheap enough for each decision."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / FILE_NAME
        self.map: mmap.mmap | None = None
        self.last = NOBODY

    def look(self) -> Holding:
        """Return who holds now; while nothing whole is there what was read last holds."""
        if self.map is None:
            try:
                with self.path.open("rb") as file:
                    self.map = mmap.mmap(file.fileno(), MEMORY_BYTES, prot=mmap.PROT_READ)
            except (OSError, ValueError):  # not there, or not allocated yet
                return self.last
        for _ in range(READS):
            found = _read(self.map)
            if found is not None:
                charge, _, fell_back, stay = found
                self.last = Holding(Site.ROBOT if fell_back else charge.site, stay, charge.token)
                break
        return self.last


def _read(memory: mmap.mmap) -> tuple[Charge, int, bool, int] | None:
    checksum, _, text = memory[:].rstrip(b"\0").partition(b" ")
    words = text.decode("ascii", "replace").split(" ")
    if len(words) != 7 or f"{zlib.crc32(text):08x}".encode() != checksum:
        return None
    site, robot, epoch, cloud, started_us, fell_back, stay = words
    try:
        token = Token(robot, int(epoch), "" if cloud == "-" else cloud)
        return Charge(Site(site), token), int(started_us), bool(int(fell_back)), int(stay)
    except ValueError:
        return None
