"""The collector's state in a file of the runtime folder: for its next life, and for processes that ask who holds.

The fence encodes and decodes the record. Another process may read while the collector writes, so a reader takes only
what is whole.
"""

from __future__ import annotations

import logging
import mmap
import os
from pathlib import Path

from robot_offload_core.collector.state import Collector
from robot_offload_core.fence import memory
from robot_offload_core.fence.gate import Charge
from robot_offload_core.fence.token import Site, Token
from robot_offload_core.words.holding import Holding

log = logging.getLogger(__name__)

FILE_NAME = "collector.memory"
MEMORY_BYTES = 256
READS = 10
"""Tries of one look: a write takes less than a microsecond, so the second is whole unless the writer died in it."""
NOBODY = Holding(Site.ROBOT, 0, Token("", 0, ""))
"""Before the first gate the collector passes the robot."""


class Memory:
    """The collector's end of the file: the charge reached so far."""

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
        written = memory.write(state.fence, state.stay)
        if written is not None:
            self.map[:] = written.ljust(MEMORY_BYTES, b"\0")

    def load(self) -> tuple[Charge, int, bool, int] | None:
        """Return (charge, started_us, fell_back, stay); None if there is no whole record."""
        found = memory.read(self.map[:])
        return None if found is None else (found.charge, found.started_us, found.fell_back, found.stay)


class HolderView:
    """The holder, as another process reads it from the collector's memory; cheap enough for each decision."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / FILE_NAME
        self.map: mmap.mmap | None = None
        self.seen, self.last = b"", NOBODY

    def look(self) -> Holding:
        """Return the present holder; without a whole record, the one that was read last."""
        if self.map is None:
            try:
                with self.path.open("rb") as file:
                    self.map = mmap.mmap(file.fileno(), MEMORY_BYTES, prot=mmap.PROT_READ)
            except (OSError, ValueError):  # not there, or not allocated yet
                return self.last
        for _ in range(READS):
            seen = self.map[:]
            if seen == self.seen:  # the usual case: it was whole when it was read before
                break
            found = memory.read(seen)
            if found is not None:
                site = Site.ROBOT if found.fell_back else found.charge.site
                self.seen, self.last = seen, Holding(site, found.stay, found.charge.token)
                break
        return self.last
