"""The state of the robot's relay, in a file of the runtime folder that survives the process.

The file is allocated at the start, so that a full disk refuses a goal and never ends one. It has two halves. Records
are appended to the current one; `compact` fills the other one and makes it the current one with its last write.
"""

from __future__ import annotations

import logging
import mmap
import os
import struct
import zlib
from collections.abc import Sequence
from pathlib import Path

log = logging.getLogger(__name__)

FILE_NAME = "relay.journal"
JOURNAL_BYTES = 24 << 20
_HEAD = struct.Struct(">4sQ16sI")  # magic, generation, nonce, checksum of these
_MAGIC = b"ROJ1"
_RECORD = struct.Struct(">II")  # size of the record, checksum over nonce and record


class Journal:
    """Appends records and reads them back, up to the first one that is not whole.

    Records end at a size of 0. A checksum covers record and nonce of the half, so records of an earlier use do not
    count.

    Attributes:
        kept: whether records survive this process; False on a disk without room.
    """

    def __init__(self, folder: Path, size: int = JOURNAL_BYTES) -> None:
        path = folder / FILE_NAME
        self.half_bytes = size // 2
        self.kept = True
        try:
            with path.open("a+b") as file:
                os.posix_fallocate(file.fileno(), 0, size)  # else a page missing later would kill us
                self.map = mmap.mmap(file.fileno(), size)
        except OSError as error:
            log.warning("%s cannot be allocated: %s; goals are lost when the relay dies", path, error)
            self.map, self.kept = mmap.mmap(-1, size), False
        heads = [self._head(half) for half in (0, 1)]
        self.current = 0 if heads[0][0] >= heads[1][0] else 1
        self.generation, self.nonce = heads[self.current]
        self.end = self.current * self.half_bytes + _HEAD.size
        if self.generation == 0:
            self.compact(())

    def load(self) -> list[bytes]:
        """Return the records of a predecessor in their order; what is appended later follows them."""
        found, at = [], self.current * self.half_bytes + _HEAD.size
        limit = (self.current + 1) * self.half_bytes
        while at + _RECORD.size <= limit:
            size, checksum = _RECORD.unpack_from(self.map, at)
            begin = at + _RECORD.size
            if not size or begin + size > limit:
                break
            record = self.map[begin : begin + size]
            if self._checksum(self.nonce, record) != checksum:
                break
            found.append(record)
            at = begin + size
        self.end = at
        return found

    def append(self, record: bytes) -> bool:
        """Append a record; return False if there is no room for it."""
        end = self._write(record, self.end, self.nonce, (self.current + 1) * self.half_bytes)
        if end is None:
            return False
        self.end = end
        return True

    def compact(self, records: Sequence[bytes]) -> bool:
        """Replace all records, at once or not at all; return False if there is no room."""
        half = 1 - self.current
        nonce, at = os.urandom(16), half * self.half_bytes + _HEAD.size
        self.map[at : at + _RECORD.size] = bytes(_RECORD.size)
        for record in records:
            end = self._write(record, at, nonce, (half + 1) * self.half_bytes)
            if end is None:
                return False
            at = end
        generation = self.generation + 1
        fields = _MAGIC, generation, nonce
        checksum = zlib.crc32(_HEAD.pack(*fields, 0))
        begin = half * self.half_bytes
        self.map[begin : begin + _HEAD.size] = _HEAD.pack(*fields, checksum)
        self.current, self.generation, self.nonce, self.end = half, generation, nonce, at
        return True

    def _write(self, record: bytes, at: int, nonce: bytes, limit: int) -> int | None:
        """Write a record and the end behind it; its size comes last, so a torn one does not count."""
        begin = at + _RECORD.size
        end = begin + len(record)
        if not record or end + _RECORD.size > limit:
            return None
        self.map[begin:end] = record
        self.map[end : end + _RECORD.size] = bytes(_RECORD.size)
        self.map[at:begin] = _RECORD.pack(len(record), self._checksum(nonce, record))
        return end

    def _head(self, half: int) -> tuple[int, bytes]:
        """Return generation and nonce of a half; generation 0 if nothing whole is there."""
        magic, generation, nonce, checksum = _HEAD.unpack_from(self.map, half * self.half_bytes)
        whole = magic == _MAGIC and zlib.crc32(_HEAD.pack(magic, generation, nonce, 0)) == checksum
        return (generation, nonce) if whole else (0, b"")

    @staticmethod
    def _checksum(nonce: bytes, record: bytes) -> int:
        return zlib.crc32(record, zlib.crc32(nonce))
