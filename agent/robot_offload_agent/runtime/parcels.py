"""Payloads too large for a datagram: they go in memory files whose descriptors travel with the datagram.

A payload takes memory until its receiver reads it, so the total is bounded: the oldest make room, best effort first.
Sender and receiver share each file. Emptying it means "taken" if the receiver does so and "taken back" if the sender
does, so neither needs another message for that.
"""

from __future__ import annotations

import os
from collections import Counter, deque
from dataclasses import dataclass

LARGEST_BYTES = 16 << 20
"""Largest payload."""
TOTAL_BYTES = 64 << 20
"""Limit of the unread bytes from one process to all others."""
TOTAL_COUNT = 64
"""Limit of their number: each takes a file descriptor."""


@dataclass(frozen=True)
class Parcel:
    """One memory file on its way; `label` names its topic for the counters, `reliable` ones are given up last."""

    file: int
    size: int
    label: str
    reliable: bool


class Parcels:
    """What one process has sent and others have not read yet.

    Attributes:
        lost: given up to make room, by label.
    """

    def __init__(self, total_bytes: int = TOTAL_BYTES, total_count: int = TOTAL_COUNT) -> None:
        self.total_bytes, self.total_count = total_bytes, total_count
        self.waiting: deque[Parcel] = deque()
        self.lost: Counter[str] = Counter()

    def pack(self, payload: bytes, label: str, reliable: bool) -> Parcel:
        """Put a payload into a memory file; give up older ones if needed.

        Raises:
            OSError: the system is out of memory or of file descriptors.
        """
        self._forget_taken()
        while self.waiting and (
            len(self.waiting) >= self.total_count or sum(p.size for p in self.waiting) + len(payload) > self.total_bytes
        ):
            self._give_up()
        file = os.memfd_create(label, os.MFD_CLOEXEC)
        try:
            view = memoryview(payload)
            while view:
                view = view[os.write(file, view) :]
        except OSError:
            os.close(file)
            raise
        parcel = Parcel(file, len(payload), label, reliable)
        self.waiting.append(parcel)
        return parcel

    def withdraw(self, parcel: Parcel) -> None:
        """Withdraw a parcel whose datagram could not be sent."""
        self.waiting.remove(parcel)
        os.close(parcel.file)

    def close(self) -> None:
        """Close this side's descriptors; what is on its way still arrives."""
        while self.waiting:
            os.close(self.waiting.popleft().file)

    def _forget_taken(self) -> None:
        for parcel in list(self.waiting):
            if os.fstat(parcel.file).st_size == 0:
                self.withdraw(parcel)

    def _give_up(self) -> None:
        parcel = next((p for p in self.waiting if not p.reliable), self.waiting[0])
        os.ftruncate(parcel.file, 0)
        self.lost[parcel.label] += 1
        self.withdraw(parcel)


def unpack(file: int) -> bytes | None:
    """Return the payload of a received memory file and free it; None if its sender gave it up meanwhile."""
    try:
        size = os.fstat(file).st_size
        payload = os.pread(file, size, 0) if size <= LARGEST_BYTES else b""
        os.ftruncate(file, 0)
    finally:
        os.close(file)
    return payload if payload and len(payload) == size else None
