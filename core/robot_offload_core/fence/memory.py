"""The record of the gate's state: one line of words with a checksum in front.

Another process may read it while the collector writes, so a reader accepts only a whole record.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass

from robot_offload_core.fence.gate import Charge, Gate
from robot_offload_core.fence.token import Site, Token

WORDS = 7


@dataclass(frozen=True)
class Record:
    """The state that a gate had reached.

    Attributes:
        charge: the charge that passed.
        started_us: start of the control process that ordered it.
        fell_back: control had fallen silent.
        stay: number of the stay.
    """

    charge: Charge
    started_us: int
    fell_back: bool
    stay: int


def write(gate: Gate, stay: int) -> bytes | None:
    """Return the record of a gate in the stay with this number; None before control's first word."""
    charge = gate.charge
    if charge is None:
        return None
    token = charge.token
    words = [charge.site.value, token.robot or "-", str(token.epoch), token.cloud or "-"]
    text = " ".join([*words, str(gate.started_us), str(int(gate.fell_back)), str(stay)]).encode()
    return b"%08x %s" % (zlib.crc32(text), text)


def read(record: bytes) -> Record | None:
    """Parse a record; return None if it is not whole."""
    checksum, _, text = record.rstrip(b"\0").partition(b" ")
    words = text.decode("ascii", "replace").split(" ")
    if len(words) != WORDS or b"%08x" % zlib.crc32(text) != checksum:
        return None
    site, robot, epoch, cloud, started_us, fell_back, stay = words
    try:
        token = Token("" if robot == "-" else robot, int(epoch), "" if cloud == "-" else cloud)
        return Record(Charge(Site(site), token), int(started_us), bool(int(fell_back)), int(stay))
    except ValueError:
        return None
