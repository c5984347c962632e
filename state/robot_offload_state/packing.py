"""The bytes of a snapshot: a header of 18 bytes and the node's data.

Big endian: magic `ROSN`, format 2, the node's version 4, size 4, CRC-32 4 (that of zlib and Ethernet).
"""

from __future__ import annotations

import struct
import zlib

MAGIC = b"ROSN"
FORMAT = 1
HEADER = struct.Struct(">4sHIII")


class SnapshotError(ValueError):
    """Bytes that are not a whole snapshot."""


def pack(version: int, data: bytes) -> bytes:
    """Return a snapshot; `version` is of the node's own format, 0 to 2**32 - 1."""
    return HEADER.pack(MAGIC, FORMAT, version, len(data), zlib.crc32(data)) + data


def unpack(snapshot: bytes) -> tuple[int, bytes]:
    """Return version and data of a snapshot; raise SnapshotError for other or incomplete bytes."""
    if len(snapshot) < HEADER.size:
        raise SnapshotError(f"{len(snapshot)} bytes are less than a header")
    magic, version_of_header, version, size, checksum = HEADER.unpack_from(snapshot)
    data = snapshot[HEADER.size :]
    if magic != MAGIC or version_of_header != FORMAT:
        raise SnapshotError("no snapshot of this format")
    if len(data) != size or zlib.crc32(data) != checksum:
        raise SnapshotError("torn: size or checksum differ")
    return version, data
