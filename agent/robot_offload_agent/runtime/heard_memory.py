"""The newest beat of the partner, in a small memory file: pulse writes each, data reads it when it sends something.

As a datagram it would wake the data process for each beat, which costs more than all the work that follows.
"""

from __future__ import annotations

import logging
import mmap
import os
import struct
import zlib
from pathlib import Path

from robot_offload_core.words.messages import Heard

log = logging.getLogger(__name__)

FILE_NAME = "heard.memory"
LAYOUT = struct.Struct("<32sqd")
CHECKSUM = struct.Struct("<I")
MEMORY_BYTES = LAYOUT.size + CHECKSUM.size
READS = 10
"""Tries of one look: a write takes less than a microsecond, so the second is whole unless the writer died in it."""


class HeardMemory:
    """The pulse process's end."""

    def __init__(self, folder: Path) -> None:
        """Open the file; the last beat of an earlier pulse process stays there until the next one.

        Raises:
            OSError: the folder cannot be written.
        """
        with (folder / FILE_NAME).open("a+b") as file:
            os.posix_fallocate(file.fileno(), 0, MEMORY_BYTES)  # else a page missing later would kill us
            self.map = mmap.mmap(file.fileno(), MEMORY_BYTES)

    def write(self, heard: Heard) -> None:
        """Replace the beat in the file."""
        body = LAYOUT.pack(heard.incarnation.encode("ascii", "replace"), heard.sent_us, heard.arrived_s)
        self.map[:] = body + CHECKSUM.pack(zlib.crc32(body))


class HeardView:
    """The data process's end."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / FILE_NAME
        self.map: mmap.mmap | None = None
        self.bytes = b""

    def news(self) -> Heard | None:
        """Return the newest beat; None if it is not newer than at the last look."""
        if self.map is None:
            try:
                with self.path.open("rb") as file:
                    self.map = mmap.mmap(file.fileno(), MEMORY_BYTES, prot=mmap.PROT_READ)
            except (OSError, ValueError):  # not there, or not allocated yet
                return None
        for _ in range(READS):
            found = self.map[:]
            if found == self.bytes:
                return None
            body = found[: LAYOUT.size]
            if CHECKSUM.unpack_from(found, LAYOUT.size)[0] == zlib.crc32(body):
                self.bytes = found
                incarnation, sent_us, arrived_s = LAYOUT.unpack(body)
                return Heard(incarnation.rstrip(b"\0").decode("ascii", "replace"), sent_us, arrived_s)
        return None
