"""Read the transforms in the bytes of a tf2_msgs/TFMessage, and leave some of them out.

Layout: CDR of the OMG (RTPS 2.5, section 10.2, plain CDR of XTypes): four bytes of encapsulation, then the sequence of
geometry_msgs/TransformStamped, every number aligned to its size, counted from the end of the encapsulation. Read by
hand so that tf2_msgs need not be installed with the agent, and thousands a second need not become objects.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass

ENCAPSULATION = 4
NUMBERS = 56
"""Bytes of translation and rotation: seven doubles."""
MAX_TRANSFORMS = 10_000
ORDERS = {b"\x00\x00": ">", b"\x00\x01": "<"}
"""Byte order by encapsulation: plain CDR, big and little endian."""


class TransformsError(ValueError):
    """The bytes are not a TFMessage."""


@dataclass(frozen=True)
class Transform:
    """One transform: its frames without a leading slash, as tf2 compares them; stamp and numbers as they came."""

    parent: str
    child: str
    stamp: bytes
    frames: tuple[bytes, bytes]
    numbers: bytes


def read(payload: bytes) -> list[Transform]:
    """Return the transforms of a message.

    Raises:
        TransformsError: the bytes are not a TFMessage.
    """
    order = ORDERS.get(bytes(payload[:2]))
    if order is None:
        raise TransformsError("not plain CDR")
    reader = _Reader(payload, order)
    count = reader.integer()
    if count > MAX_TRANSFORMS:
        raise TransformsError(f"{count} transforms")
    found = []
    for _ in range(count):
        stamp = reader.take(8, 4)
        parent, child = reader.text(), reader.text()
        numbers = reader.take(NUMBERS, 8)
        found.append(Transform(_name(parent), _name(child), stamp, (parent, child), numbers))
    return found


def only(payload: bytes, wanted: Callable[[Transform], bool]) -> bytes | None:
    """Return a message with only the wanted transforms: None if none is wanted, the same bytes if all are.

    Raises:
        TransformsError: the bytes are not a TFMessage.
    """
    found = read(payload)
    kept = [transform for transform in found if wanted(transform)]
    if not kept:
        return None
    return payload if len(kept) == len(found) else _written(bytes(payload[:2]), kept)


def _written(encapsulation: bytes, transforms: list[Transform]) -> bytes:
    order = ORDERS[encapsulation]
    body = bytearray(struct.pack(f"{order}I", len(transforms)))

    def put(data: bytes, align: int) -> None:
        body.extend(bytes(-len(body) % align) + data)

    for transform in transforms:
        put(transform.stamp, 4)
        for text in transform.frames:
            put(struct.pack(f"{order}I", len(text)) + text, 4)
        put(transform.numbers, 8)
    return encapsulation + b"\0\0" + bytes(body)


def _name(text: bytes) -> str:
    return text.rstrip(b"\0").decode("utf-8", "replace").lstrip("/")


class _Reader:
    """Takes aligned pieces of the bytes, one after the other."""

    def __init__(self, payload: bytes, order: str) -> None:
        self.payload = payload
        self.order = order
        self.place = ENCAPSULATION

    def take(self, size: int, align: int) -> bytes:
        start = self.place + -(self.place - ENCAPSULATION) % align
        if start + size > len(self.payload):
            raise TransformsError("too short")
        self.place = start + size
        return bytes(self.payload[start : self.place])

    def integer(self) -> int:
        value: int = struct.unpack(f"{self.order}I", self.take(4, 4))[0]
        return value

    def text(self) -> bytes:
        return self.take(self.integer(), 1)
