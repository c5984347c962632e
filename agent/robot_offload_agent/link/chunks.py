"""Messages too large to be put at once cross in chunks, a window of them at a time. Pure: time is passed in.

The wheel drops a message if a part of it finds no room in its queue for 40 ms. The queue holds 1 MB, so this happened
to 16 MB on loopback and to everything above 1.5 MB on 100 Mbit/s. Put at once, such a message would also be a queue in
which all others wait.
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
"""Most bytes that are put together: the largest message that the agent passes on, and what surrounds it."""
FIRST_CHUNKS = 4
LEAST_CHUNKS = 2
MOST_CHUNKS = 32
"""1.9 MB on their way: 150 Mbit/s at 100 ms."""
QUEUED_SHARE = 1.5
QUEUED_S = 0.020
"""A chunk that takes this much longer than one and a half times the fastest of its message has waited in a queue."""
STALL_S = 1.0
"""Without an acknowledgement for this long all are sent again."""
GIVE_UP_S = 10.0
"""Without one for this long the message is given up. A session over a link that is cut ends before."""
AT_ONCE = 2
PLACE = struct.Struct(">IHH")
"""On the wire in front of the header: number of the message, index of the chunk, how many there are."""
RECEIPT = struct.Struct(">IH")
"""An acknowledgement: number of the message, index of the chunk; the channel's name follows."""


@dataclass
class Window:
    """How many chunks may be on their way: as many as the link carries without a queue in which others would wait.

    Attributes:
        size: chunks.
        least_s: shortest time that a chunk of the present message took; 0: not known.
        shrunk_s: when the window last became smaller; None: the capacity of the link is still being measured.
    """

    size: float = FIRST_CHUNKS
    least_s: float = 0.0
    shrunk_s: float | None = None

    def acknowledged(self, sent_s: float, now_s: float) -> None:
        """Take the time of a chunk: halve the window, once for all that were on their way, or let it grow."""
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
        waiting: when each unacknowledged chunk was sent, oldest first.
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
    """Sends a channel's large messages one after the other, never two at a time.

    Attributes:
        number: of the newest message; begins at a random one, so that a successor's numbers differ.
        window: of the channel.
        present: the message on its way.
        refused: a message was refused since the channel was free.
        given_up: messages that were not acknowledged.
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
        """Return whether a message is on its way; if so, record that another one was refused."""
        self.refused = self.present is not None
        return self.refused

    def next(self, now_s: float) -> tuple[bytes, bytes] | None:
        """Return attachment and payload of the chunk to send now, None if none is to be sent."""
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

        They come in the order of sending: an earlier chunk that is still unacknowledged found no room in the queue.
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
    """Puts a channel's chunks together: of the newest message, and of an earlier one that comes by another session.

    Attributes:
        parts: of messages that are not whole, by number and index.
        whole: numbers of the newest whole messages.
    """

    parts: dict[int, dict[int, bytes]] = field(default_factory=dict)
    whole: deque[int] = field(default_factory=lambda: deque(maxlen=AT_ONCE))

    def take(self, attachment: bytes, payload: bytes) -> tuple[bytes, bytes] | None:
        """Take a chunk; return header and payload of the message that is whole now.

        Raises:
            ValueError: the chunk is not valid.
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
        ValueError: it is not an acknowledgement.
    """
    if len(payload) < RECEIPT.size:
        raise ValueError(f"{len(payload)} bytes")
    number, index = RECEIPT.unpack_from(payload)
    return number, index, payload[RECEIPT.size :].decode(errors="replace")
