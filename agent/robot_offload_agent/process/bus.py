"""How the processes of one agent talk: unix datagrams in the runtime folder, one socket per process.

Losing a datagram loses nothing: everything that matters is a level, told again with every beat period. A sender never
waits: a receiver that is stopped or dead costs its sender nothing.

A datagram is one kind byte and a body: for `MESSAGE` JSON `[name, fields]` of a registered dataclass, for `ENVELOPE`
and `PASSED` an output index, a header and the payload.
"""

from __future__ import annotations

import contextlib
import json
import logging
import socket
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from pathlib import Path
from types import UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

from robot_offload_core import placement
from robot_offload_core.envelope import LAYOUT
from robot_offload_core.process.messages import (
    ENVELOPE,
    PASSED,
    Arrived,
    Carried,
    CollectorStatus,
    DataStatus,
    Egress,
    Fatal,
    Heard,
    Limits,
    Notes,
    Orders,
    PulseStatus,
    Speak,
)

log = logging.getLogger(__name__)

MESSAGE = b"m"
MAX_DATAGRAM = 190_000
"""Largest datagram with the kernel's default socket buffers (212,992 bytes less its own accounting)."""


KINDS: dict[str, type] = {
    cls.__name__: cls
    for cls in (
        Speak, Arrived, Heard, PulseStatus, Orders, Egress, DataStatus, CollectorStatus, Notes, Limits, Fatal,
        placement.PulseSent, placement.SetGate, placement.Reopen,
    )
}  # fmt: skip


class Bus:
    """One process's socket."""

    def __init__(self, folder: Path, name: str) -> None:
        """Binds `<folder>/<name>.sock`, taking it over from a dead predecessor."""
        self.folder = folder
        self.name = name
        path = folder / f"{name}.sock"
        with contextlib.suppress(FileNotFoundError):
            path.unlink()
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 20)
        self.socket.setblocking(False)
        self.socket.bind(str(path))
        self.dropped = 0
        self.addresses: dict[str, str] = {}

    def fileno(self) -> int:
        """For select."""
        return self.socket.fileno()

    def send(self, to: str, message: Any) -> bool:
        """Sends a registered dataclass; False when the receiver is absent or full."""
        body = json.dumps([type(message).__name__, plain(message)], separators=(",", ":"))
        return self._send(to, MESSAGE + body.encode())

    def carry(self, to: str, kind: bytes, index: int, header: bytes, payload: bytes) -> bool:
        """Sends an output's message with its header."""
        return self._send(to, b"".join((kind, index.to_bytes(2, "big"), header, payload)))

    def _send(self, to: str, datagram: bytes) -> bool:
        if len(datagram) <= MAX_DATAGRAM:  # a larger one would be cut off by its receiver
            try:
                self.socket.sendto(datagram, self._address(to))
            except OSError:  # absent or full: the same to a sender that never waits
                pass
            else:
                return True
        self.dropped += 1
        return False

    def _address(self, to: str) -> str:
        if to not in self.addresses:
            self.addresses[to] = str(self.folder / f"{to}.sock")
        return self.addresses[to]

    def receive(self) -> Any | None:
        """The next datagram as an object, None when there is none. Garbage is logged and left out."""
        while True:
            try:
                datagram = self.socket.recv(MAX_DATAGRAM)
            except BlockingIOError:
                return None
            try:
                return _read(datagram)
            except (ValueError, KeyError, TypeError) as error:
                log.warning("Dropped a datagram that is no message of ours: %s", error)

    def close(self) -> None:
        """Closes the socket."""
        self.socket.close()


def _read(datagram: bytes) -> Any:
    kind = datagram[:1]
    if kind == MESSAGE:
        name, body = json.loads(datagram[1:])
        return typed(KINDS[name], body)
    if kind in (ENVELOPE, PASSED):
        start = 3 + LAYOUT.size
        return Carried(kind, int.from_bytes(datagram[1:3], "big"), datagram[3:start], datagram[start:])
    raise ValueError(f"kind {kind!r}")


def plain(value: Any) -> Any:
    """Dataclasses -> lists of their fields, enums -> values, tuples -> lists."""
    if is_dataclass(value):
        return [plain(getattr(value, field.name)) for field in fields(value)]
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, tuple):
        return [plain(v) for v in value]
    return value


def typed(kind: Any, value: Any) -> Any:
    """The inverse of `plain` for the type `kind`."""
    origin = get_origin(kind)
    if origin in (Union, UnionType):
        members = [m for m in get_args(kind) if m is not type(None)]
        if value is None:
            return None
        if len(members) == 1:
            return typed(members[0], value)
        return typed(_by_length(members, value), value)
    if origin is tuple:
        arguments = get_args(kind)
        if len(arguments) == 2 and arguments[1] is Ellipsis:
            return tuple(typed(arguments[0], v) for v in value)
        return tuple(typed(a, v) for a, v in zip(arguments, value, strict=True))
    if is_dataclass(kind):
        make: Any = kind
        return make(*(typed(h, v) for h, v in zip(_field_types(make), value, strict=True)))
    if isinstance(kind, type) and issubclass(kind, Enum):
        return kind(value)
    return value


def _by_length(members: list[Any], value: list[Any]) -> Any:
    """Unions of ours differ in their number of fields."""
    return next(m for m in members if len(fields(m)) == len(value))


@cache
def _field_types(cls: Any) -> tuple[Any, ...]:
    hints = get_type_hints(cls)
    return tuple(hints[field.name] for field in fields(cls))
