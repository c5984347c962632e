"""How the processes of one agent communicate: unix datagrams in the runtime folder, one socket per process.

A lost datagram does no harm: everything that matters is a level, sent again with every beat period. A sender never
waits. The kernel charges unread datagrams to the socket that sent them, so there is one sending socket for each
receiver: a stopped receiver holds up only its own datagrams.

Waking a process costs more than it does with most messages. So a level that is only repeated stays in the inbox until
its receiver wakes for another reason. A new message rings a bell, a second socket, for which control, data and
collector wait. There is one inbox, so a new message never overtakes what was sent before.

A datagram is one kind byte and a body: for `MESSAGE` JSON `[name, fields]` of a registered dataclass, for `ENVELOPE`
and `PASSED` an output index, a header and the payload, for `LETTERS` the bytes of `Letters`. Messages sent with every
beat are records, see `records.py`. A payload above `MAX_INLINE` travels beside its datagram, see `parcels.py`.
"""

from __future__ import annotations

import array
import contextlib
import json
import logging
import os
import socket
import threading
from collections import Counter
from pathlib import Path
from typing import Any

from robot_offload_agent.runtime import parcels, records
from robot_offload_core.fence.envelope import LAYOUT
from robot_offload_core.words.codec import plain, typed
from robot_offload_core.words.messages import (
    ENVELOPE,
    OTHERS,
    PASSED,
    Alive,
    Arrived,
    Carried,
    CloudTypes,
    CollectorStatus,
    DataStatus,
    Egress,
    Fatal,
    Heard,
    HolderChanged,
    Letters,
    Limits,
    Lives,
    Notes,
    Orders,
    PulseSent,
    PulseStatus,
    RelayOrders,
    RelayStatus,
    Reopen,
    Reported,
    SetGate,
    Speak,
    Unheard,
)

log = logging.getLogger(__name__)

MESSAGE = b"m"
LETTERS = b"l"
MAX_INLINE = 64 << 10
"""Larger payloads travel in memory files."""
MAX_DATAGRAM = 190_000
"""Largest datagram with the kernel's default socket buffers (212,992 bytes less its own accounting)."""
FULL = 8
"""This many datagrams in a row mean that the inbox was nearly full: many kernels hold ten."""
_BESIDE = {ENVELOPE: b"E", PASSED: b"P", OTHERS: b"O", LETTERS: b"L"}
_KINDS = {beside: kind for kind, beside in _BESIDE.items()}
_RIGHTS_BYTES = socket.CMSG_SPACE(array.array("i").itemsize)


KINDS: dict[str, type] = {
    cls.__name__: cls
    for cls in (
        Speak, Arrived, Heard, PulseStatus, Orders, Egress, DataStatus, CollectorStatus, CloudTypes, Notes, Limits,
        HolderChanged, RelayOrders, RelayStatus, Fatal, Alive, Unheard, Lives, Reported,
        PulseSent, SetGate, Reopen,
    )
}  # fmt: skip


class Bus:
    """One process's socket. Any thread may send, one thread receives.

    Attributes:
        dropped: datagrams that could not be sent.
        garbage: datagrams that were not valid messages.
        too_large: size in bytes of the largest payload refused, by label.
    """

    def __init__(self, folder: Path, name: str) -> None:
        """Bind `<folder>/<name>.sock` and `.bell`, taking them over from a dead predecessor."""
        self.folder = folder
        self.name = name
        self.socket = _bound(folder / f"{name}.sock")
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        self.bell = _bound(folder / f"{name}.bell")
        self.row = self.last_row = 0
        self.lock = threading.RLock()
        self.outgoing: dict[str, tuple[socket.socket, str]] = {}
        self.buffer = bytearray(MAX_DATAGRAM)
        self.parcels = parcels.Parcels()
        self.dropped = 0
        self.garbage = 0
        self.too_large: dict[str, int] = {}

    def fileno(self) -> int:
        """Return the inbox's descriptor for select, for processes that wake for each datagram."""
        return self.socket.fileno()

    @property
    def news(self) -> socket.socket:
        """Return the descriptor to select for in a process that wakes only for new messages: the bell.

        While the inbox fills up faster than it is read, return the inbox.
        """
        return self.socket if self.last_row >= FULL else self.bell

    def send(self, to: str, message: Any) -> bool:
        """Send Letters or a registered dataclass; return False if the receiver is absent or full."""
        if isinstance(message, Letters):
            return self._carry(to, LETTERS, b"", message.data, "letters", reliable=True)
        sent = self._send(to, _written(message))
        self._ring(to)
        return sent

    def renew(self, to: str, message: Any) -> bool:
        """Send an unchanged level: its receiver reads it when it wakes for another reason."""
        return self._send(to, _written(message))

    def carry(
        self, to: str, kind: bytes, index: int, header: bytes, payload: bytes, label: str = "", reliable: bool = True
    ) -> bool:
        """Send an output's message with its header.

        Args:
            to: the receiving process.
            kind: ENVELOPE, PASSED or OTHERS.
            index: of the output.
            header: the envelope's header.
            payload: up to `parcels.LARGEST_BYTES`.
            label: the output's name, for the counters.
            reliable: False: the message makes room for others if the receiver does not keep up with large messages.

        Returns:
            False if it could not be sent: the receiver is absent or full, or the payload is too large.
        """
        return self._carry(to, kind, index.to_bytes(2, "big") + header, payload, label, reliable)

    def _carry(self, to: str, kind: bytes, where: bytes, payload: bytes, label: str, reliable: bool) -> bool:
        if len(payload) <= MAX_INLINE:
            sent = self._send(to, b"".join((kind, where, payload)))
            self._ring(to)
            return sent
        if len(payload) > parcels.LARGEST_BYTES:
            self.too_large[label] = max(len(payload), self.too_large.get(label, 0))
            self.dropped += 1
            return False
        with self.lock:  # the parcels are this object's, threads share it
            try:
                parcel = self.parcels.pack(payload, label, reliable)
            except OSError:
                self.dropped += 1
                return False
            sent = self._send(to, _BESIDE[kind] + where, parcel.file)
            if not sent:
                self.parcels.withdraw(parcel)
        self._ring(to)
        return sent

    def losses(self) -> Counter[str]:
        """Return how many large messages were given up because their receiver did not keep up, by label."""
        return self.parcels.lost

    def _send(self, to: str, datagram: bytes, file: int | None = None) -> bool:
        if len(datagram) <= MAX_DATAGRAM:  # a larger one would be cut off by its receiver
            outgoing, address = self.outgoing.get(to) or self._open(to)
            try:
                if file is None:
                    outgoing.sendto(datagram, address)
                else:
                    rights = [(socket.SOL_SOCKET, socket.SCM_RIGHTS, array.array("i", [file]))]
                    outgoing.sendmsg([datagram], rights, 0, address)
            except OSError:  # absent or full: the same to a sender that never waits
                pass
            else:
                return True
        self.dropped += 1
        return False

    def _ring(self, to: str) -> None:
        """Wake a receiver; one whose bell is full of rings is already being woken."""
        outgoing, _ = self.outgoing.get(to) or self._open(to)
        with contextlib.suppress(OSError):
            outgoing.sendto(b"", f"{self.folder}/{to}.bell")

    def _open(self, to: str) -> tuple[socket.socket, str]:
        with self.lock:
            if to not in self.outgoing:
                self.outgoing[to] = _socket(), str(self.folder / f"{to}.sock")
                self.outgoing[to][0].setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 20)
            return self.outgoing[to]

    def receive(self) -> Any | None:
        """Return the next datagram as an object, None without one; count garbage, log it once and skip it."""
        if not self.row:  # before the first of a row is read: what comes later rings again
            self._hush()
        while True:
            try:
                size, rights, _, _ = self.socket.recvmsg_into([self.buffer], _RIGHTS_BYTES, socket.MSG_CMSG_CLOEXEC)
            except BlockingIOError:
                self.row, self.last_row = 0, self.row
                return None
            self.row += 1
            files = _files(rights)
            try:
                message = _read(bytes(memoryview(self.buffer)[:size]), files)
            except (ValueError, KeyError, TypeError, RecursionError, OSError) as error:
                self.garbage += 1
                if self.garbage == 1:
                    log.warning("Dropped a datagram that is not one of ours, further ones are only counted: %s", error)
                continue
            finally:
                for file in files:
                    os.close(file)
            if message is not None:
                return message

    def _hush(self) -> None:
        """Take all rings of the bell."""
        with contextlib.suppress(BlockingIOError):
            while True:
                self.bell.recv(1)

    def close(self) -> None:
        """Close the sockets."""
        self.parcels.close()
        for outgoing, _ in self.outgoing.values():
            outgoing.close()
        self.socket.close()
        self.bell.close()


def _socket() -> socket.socket:
    return socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)


def _bound(path: Path) -> socket.socket:
    """Return a socket of this name, taken over from a dead predecessor."""
    with contextlib.suppress(FileNotFoundError):
        path.unlink()
    made = _socket()
    made.bind(str(path))
    return made


def _written(message: Any) -> bytes:
    """Return the datagram of a registered dataclass."""
    record = records.packed(message)
    if record is not None:
        return record
    return MESSAGE + json.dumps([type(message).__name__, plain(message)], separators=(",", ":")).encode()


def _files(rights: list[tuple[int, int, bytes]]) -> list[int]:
    """Return the descriptors that came with a datagram."""
    found = array.array("i")
    for level, kind, data in rights:
        if (level, kind) == (socket.SOL_SOCKET, socket.SCM_RIGHTS):
            found.frombytes(data[: len(data) - len(data) % found.itemsize])
    return list(found)


def _read(datagram: bytes, files: list[int]) -> Any | None:
    """Read a datagram; return None if its sender has given up its payload meanwhile."""
    kind = datagram[:1]
    if kind in (records.ARRIVED, records.SPEAK):
        return records.unpacked(datagram)
    if kind == MESSAGE:
        name, body = json.loads(datagram[1:])
        return typed(KINDS[name], body)
    if kind == LETTERS:
        return Letters(datagram[1:])
    if kind == _BESIDE[LETTERS]:
        letters = _beside(kind, files)
        return None if letters is None else Letters(letters)
    start = 3 + LAYOUT.size
    if len(datagram) < start:
        raise ValueError(f"{len(datagram)} bytes of kind {kind!r}")
    where = int.from_bytes(datagram[1:3], "big"), datagram[3:start]
    if kind in _BESIDE:
        return Carried(kind, *where, datagram[start:])
    beside = _KINDS[kind]
    payload = _beside(kind, files)
    return None if payload is None else Carried(beside, *where, payload)


def _beside(kind: bytes, files: list[int]) -> bytes | None:
    """Return the payload in the file that came with a datagram; None if its sender has given it up."""
    if len(files) != 1:
        raise ValueError(f"{len(files)} files with kind {kind!r}")
    return parcels.unpack(files.pop())
