"""The two messages that are sent with every beat, as records: fixed places instead of JSON and type hints.

Code that runs 50 times a second runs with cold caches; there JSON with its types takes a third longer to read and half
as long again to write. A message that does not fit a record is sent like any other.
"""

from __future__ import annotations

import math
import struct
from typing import Any

from robot_offload_core.words.beats import Permission
from robot_offload_core.words.messages import Arrived, PulseSent, Speak

ARRIVED = b"a"
SPEAK = b"s"
_ARRIVED = struct.Struct("<dqdB")
"""Arrival time, wall_us, sending time of this side's beat, flags; then the beat."""
_SENT, _GRANTED = 1, 2
_SPEAK = struct.Struct("<dqqBB")
"""Time of the order, epoch, lease_us, flags, length of this side's incarnation; then that and the cloud's."""
_MAY_ACT, _IN_CHARGE, _PRESENT = 1, 2, 4


def packed(message: Any) -> bytes | None:
    """Return the datagram of a message that has a record and fits it, else None."""
    try:
        if message.__class__ is Arrived:
            return _pack_arrived(message)
        if message.__class__ is Speak and message.body.__class__ is Permission:
            return _pack_permission(message, message.body)
    except (struct.error, UnicodeEncodeError):
        pass
    return None


def unpacked(datagram: bytes) -> Arrived | Speak:
    """Return the message of a datagram whose kind is ARRIVED or SPEAK; raise ValueError for anything else in it."""
    try:
        return _arrived(datagram) if datagram[:1] == ARRIVED else _permission(datagram)
    except struct.error as error:
        raise ValueError(f"{len(datagram)} bytes of kind {datagram[:1]!r}") from error


def _pack_arrived(message: Arrived) -> bytes:
    sent = message.sent
    flags = 0 if sent is None else _SENT | (_GRANTED if sent.granted else 0)
    head = _ARRIVED.pack(message.arrived_s, message.wall_us, 0.0 if sent is None else sent.sent_s, flags)
    return ARRIVED + head + message.text.encode("ascii")


def _arrived(datagram: bytes) -> Arrived:
    arrived_s, wall_us, sent_s, flags = _ARRIVED.unpack_from(datagram, 1)
    if flags not in (0, _SENT, _SENT | _GRANTED) or math.isnan(arrived_s) or math.isnan(sent_s):
        raise ValueError(f"a beat at {arrived_s} s with {flags}")
    sent = PulseSent(sent_s, flags == _SENT | _GRANTED) if flags else None
    return Arrived(datagram[1 + _ARRIVED.size :].decode("ascii"), arrived_s, wall_us, sent)


def _pack_permission(message: Speak, body: Permission) -> bytes:
    flags = body.granted * _MAY_ACT | body.in_charge * _IN_CHARGE | body.presence * _PRESENT
    ours = message.incarnation.encode("ascii")
    head = _SPEAK.pack(message.said_s, body.epoch, body.lease_us, flags, len(ours))
    return SPEAK + head + ours + body.cloud.encode("ascii")


def _permission(datagram: bytes) -> Speak:
    said_s, epoch, lease_us, flags, length = _SPEAK.unpack_from(datagram, 1)
    names = datagram[1 + _SPEAK.size :].decode("ascii")
    if flags > _MAY_ACT | _IN_CHARGE | _PRESENT or len(names) < length or math.isnan(said_s):
        raise ValueError(f"a permission at {said_s} s with {flags} and {len(names)} letters")
    body = Permission(
        epoch, bool(flags & _MAY_ACT), names[length:], lease_us, bool(flags & _IN_CHARGE), bool(flags & _PRESENT)
    )
    return Speak(names[:length], body, said_s)
