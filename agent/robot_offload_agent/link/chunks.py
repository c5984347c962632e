"""Messages too large to be put at once cross in chunks, a window of them at a time. Pure: time is passed in.

The wheel drops a message when a part of it finds no room in its queue for 40 ms. The queue holds 1 MB, so on loopback
that was the end of 16 MB, and on 100 Mbit/s of everything above 1.5 MB. Put at once, such a message would also be a
queue that all others wait in.
"""

from __future__ import annotations

import struct
from collections import deque
from dataclasses import dataclass, field

WHOLE_BYTES = 1_020_000
"""Larger messages cross in chunks; these fit into the wheel's queue (16 batches of 64 KiB)."""
CHUNK_BYTES = 60_000
"""One batch of the wheel with its key and attachment."""
LARGEST_BYTES = 17 << 20
"""What is put together at most: the largest message that the agent hands over, and what surrounds it."""
FIRST_CHUNKS = 4
LEAST_CHUNKS = 2
MOST_CHUNKS = 32
"""1.9 MB on their way: 150 Mbit/s at 100 ms."""
QUEUED_SHARE = 1.5
QUEUED_S = 0.020
"""A chunk that takes longer than half as long again as the fastest of its message, and this, has waited in a queue."""
STALL_S = 1.0
"""Without an acknowledgement for so long all are sent again."""
GIVE_UP_S = 10.0
"""Without one for so long the message is given up. A session over a link that is cut ends before."""
AT_ONCE = 2
PLACE = struct.Struct(">IHH")
"""On the wire in front of the header: number of the message, index of the chunk, how many there are."""
RECEIPT = struct.Struct(">IH")
"""An acknowledgement: number of the message, index of the chunk; the channel's name follows."""


@dataclass
class Window:
    """How many chunks may be on their way: as many as the link carries without a queue that others would wait in.

    Attributes:
        size: chunks.
        least_s: shortest time that a chunk of the present message took; 0: not known.
        shrunk_s: when the window last became smaller; None: it is still found out what the link carries.
    """

    size: float = FIRST_CHUNKS
    least_s: float = 0.0
    shrunk_s: float | None = None

    def acknowledged(self, sent_s: float, now_s: float) -> None:
        """Take what a chunk took: halve the window, once for all that were on their way, or let it grow."""
        took_s = now_s - sent_s
        self.least_s = min(took_s, self.least_s) if self.least_s else took_s
        if took_s <= QUEUED_SHARE * self.least_s + QUEUED_S:
            self.size = min(MOST_CHUNKS, self.size + (1.0 if self.shrunk_s is None else 1.0 / self.size))
        elif self.shrunk_s is None or sent_s > self.shrunk_s:
            self.shrink(now_s)

    def shrink(self, now_s: float) -> None:
        """Halve the window."""
        self.size, self.shrunk_s = max(LEAST_CHUNKS, self.size / 2), now_s


@dataclass
class Outgoing:
    """A large message on its way out.

    Attributes:
        number: of the message.
        header, payload: its content.
        pending: chunks that are still to be sent.
        waiting: when each that is not acknowledged was sent, oldest first.
        heard_s: when it began, or was last acknowledged.
        repeated_s: when all were last sent again.
    """

    number: int
    header: bytes
    payload: bytes
    heard_s: float
    pending: deque[int] = field(default_factory=deque)
    waiting: dict[int, float] = field(default_factory=dict)
    repeated_s: float = float("-inf")

    @property
    def count(self) -> int:
        """How many chunks there are."""
        return -(-len(self.payload) // CHUNK_BYTES)

    def chunk(self, index: int) -> tuple[bytes, bytes]:
        """Return attachment and payload of a chunk."""
        start = index * CHUNK_BYTES
        return PLACE.pack(self.number, index, self.count) + self.header, self.payload[start : start + CHUNK_BYTES]


@dataclass
class ChunkSender:
    """Sends one large message of a channel after the other, never two at a time.

    Attributes:
        number: of the newest message; begins anywhere, so that a successor's are others.
        window: of the channel.
        present: on its way.
        refused: a message was refused since the channel was free.
        given_up: messages that nobody acknowledged.
    """

    number: int
    window: Window = field(default_factory=Window)
    present: Outgoing | None = None
    refused: bool = False
    given_up: int = 0

    def offer(self, header: bytes, payload: bytes, now_s: float) -> bool:
        """Take a message to send; False while another one is on its way."""
        if self.is_busy():
            return False
        self.number = (self.number + 1) % (1 << 32)
        self.present = Outgoing(self.number, header, payload, now_s)
        self.present.pending.extend(range(self.present.count))
        self.window.least_s = 0.0
        return True

    def is_busy(self) -> bool:
        """Return whether a message is on its way; note that another one was refused for that."""
        self.refused = self.present is not None
        return self.refused

    def next(self, now_s: float) -> tuple[bytes, bytes] | None:
        """Return attachment and payload of the chunk to send now, None while none is to be sent."""
        message = self.present
        if message is None:
            return None
        if now_s - message.heard_s >= GIVE_UP_S:
            self.present, self.given_up = None, self.given_up + 1
            return None
        if message.waiting and now_s - max(message.heard_s, message.repeated_s) >= STALL_S:
            message.repeated_s = now_s
            message.pending.extendleft(reversed(message.waiting))
            message.waiting.clear()
            self.window.shrink(now_s)
        if not message.pending or len(message.waiting) >= int(self.window.size):
            return None
        index = message.pending.popleft()
        message.waiting[index] = now_s
        return message.chunk(index)

    def acknowledged(self, number: int, index: int, now_s: float) -> bool:
        """Take an acknowledgement; return whether there is room again after a refusal. Unknown ones change nothing.

        They come in the order of sending: what was sent before and is still waited for found no room in the queue.
        """
        message = self.present
        if message is None or message.number != number or index not in message.waiting:
            return False
        while (earlier := next(iter(message.waiting))) != index:
            del message.waiting[earlier]
            message.pending.append(earlier)
        self.window.acknowledged(message.waiting.pop(index), now_s)
        message.heard_s = now_s
        if message.pending or message.waiting:
            return False
        self.present = None
        had_refused, self.refused = self.refused, False
        return had_refused


@dataclass
class Assembly:
    """Puts the chunks of a channel together: of the newest message, and of one before that comes by another session.

    Attributes:
        parts: of messages that are not whole, by number and index.
        whole: numbers of the newest ones that are.
    """

    parts: dict[int, dict[int, bytes]] = field(default_factory=dict)
    whole: deque[int] = field(default_factory=lambda: deque(maxlen=AT_ONCE))

    def take(self, attachment: bytes, payload: bytes) -> tuple[bytes, bytes] | None:
        """Take a chunk; return header and payload of the message that is whole now.

        Raises:
            ValueError: the chunk is none of ours.
        """
        if len(attachment) < PLACE.size:
            raise ValueError(f"{len(attachment)} bytes in front of a chunk")
        number, index, count = PLACE.unpack_from(attachment)
        if not index < count <= LARGEST_BYTES // CHUNK_BYTES + 1 or len(payload) > CHUNK_BYTES:
            raise ValueError(f"chunk {index} of {count} with {len(payload)} bytes")
        if number in self.whole:
            return None  # sent once more
        parts = self.parts.setdefault(number, {})
        if len(self.parts) > AT_ONCE:
            del self.parts[next(iter(self.parts))]
        parts[index] = payload
        if any(each not in parts for each in range(count)):
            return None
        del self.parts[number]
        self.whole.append(number)
        return attachment[PLACE.size :], b"".join(parts[each] for each in range(count))


def receipt(attachment: bytes, channel: str) -> bytes:
    """Return the acknowledgement of a chunk."""
    return attachment[: RECEIPT.size] + channel.encode()


def read_receipt(payload: bytes) -> tuple[int, int, str]:
    """Return number, index and channel of an acknowledgement.

    Raises:
        ValueError: it is none.
    """
    if len(payload) < RECEIPT.size:
        raise ValueError(f"{len(payload)} bytes")
    number, index = RECEIPT.unpack_from(payload)
    return number, index, payload[RECEIPT.size :].decode(errors="replace")
