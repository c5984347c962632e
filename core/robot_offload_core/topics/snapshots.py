"""Check snapshots of a node's state on their way from the holder to the standby: are they whole and newer?

A node publishes its state as `std_msgs/UInt8MultiArray` on `~/offload/state`: bytes with a header of 18, magic `ROSN`,
format 2, the node's own version 4, size 4, CRC-32 4 (big endian). The agents' envelope adds order and age: it carries
token, sequence and echo reference. The bytes after the header are the node's and are not read here.

CRC-32 is that of zlib and Ethernet (ISO-HDLC), which every standard library has; a CRC-32C written in Python would
take 0.1 s for a mebibyte.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from enum import Enum

from robot_offload_core.fence.envelope import Envelope
from robot_offload_core.words.replace import replace

MAGIC = b"ROSN"
FORMAT = 1
HEADER = struct.Struct(">4sHIII")
_ARRAY = struct.Struct("<4I")
"""Header of a UInt8MultiArray in little-endian CDR: encapsulation, dimensions, offset, length."""
_LITTLE_ENDIAN = b"\x00\x01"


class Refused(str, Enum):
    """Why a snapshot is not given to a node."""

    FOREIGN = "is no snapshot: no header of ours"
    OTHER_FORMAT = "has a header of another format; install the same robot_offload_state on both sides"
    TORN = "is torn: size or checksum differ from what its header says"
    TOO_LARGE = "is larger than its maxSize"
    OLDER = "is not newer than what the node has"


@dataclass(frozen=True)
class Snapshot:
    """A whole snapshot.

    Attributes:
        version: of the node's own format.
        data: the node's bytes.
    """

    version: int
    data: bytes


def parse(message: bytes, max_size: int) -> Snapshot | Refused:
    """Read a snapshot from a serialized UInt8MultiArray.

    Args:
        message: CDR as the middleware delivers it; may come from any node.
        max_size: most bytes of the node's data.
    """
    if len(message) < _ARRAY.size or message[:2] != _LITTLE_ENDIAN:
        return Refused.FOREIGN
    _, dimensions, _, length = _ARRAY.unpack_from(message)
    # Padding to a multiple of four may follow.
    if dimensions or not length <= len(message) - _ARRAY.size < length + 4:
        return Refused.FOREIGN
    packed = message[_ARRAY.size : _ARRAY.size + length]
    if length < HEADER.size or packed[:4] != MAGIC:
        return Refused.FOREIGN
    _, version_of_header, version, size, checksum = HEADER.unpack_from(packed)
    if version_of_header != FORMAT:
        return Refused.OTHER_FORMAT
    if length - HEADER.size > max_size:
        return Refused.TOO_LARGE
    data = packed[HEADER.size :]
    if len(data) != size or zlib.crc32(data) != checksum:
        return Refused.TORN
    return Snapshot(version, data)


@dataclass(frozen=True)
class Standing:
    """The newest snapshot of one node's state at the standby.

    Attributes:
        robot: incarnation of the robot's control under which it came; only epochs of one incarnation are compared.
        epoch, sequence: of the newest snapshot taken.
        taken_s: when it arrived, on this host's clock; None before the first one.
        age_s: upper bound of its age at that moment.
    """

    robot: str = ""
    epoch: int = 0
    sequence: int = 0
    taken_s: float | None = None
    age_s: float = 0.0

    def aged_s(self, now_s: float) -> float:
        """Return an upper bound of the snapshot's age, seconds; infinite before the first one."""
        return float("inf") if self.taken_s is None else now_s - self.taken_s + self.age_s


def take(standing: Standing, opened: Envelope, now_s: float) -> Standing | Refused:
    """Return the standing with an arrived snapshot, or OLDER if the snapshot is not newer.

    Args:
        standing: what the standby has.
        opened: header of the arrived snapshot.
        now_s: of this host's steady clock.
    """
    same = opened.token.robot == standing.robot
    if same and (opened.token.epoch, opened.sequence) <= (standing.epoch, standing.sequence):
        return Refused.OLDER
    return replace(
        standing, robot=opened.token.robot, epoch=opened.token.epoch, sequence=opened.sequence, taken_s=now_s,
        age_s=opened.age_s(now_s),
    )  # fmt: skip
