"""What an emulated link does to each packet: pure and seeded, time only as an argument.

A link has two directions, `up` (robot to cloud) and `down`. Everything that crosses a direction, datagrams
and TCP streams, shares one `DirectionModel`: one queue, one order, one sequence of random draws.

What is not modelled: TCP's congestion window (a loss delays a stream, it does not slow it down), the
handshake of the client's own TCP connection (the kernel answers it at once), acknowledgements lost in the
other direction, and packet sizes beyond what the rate needs.
"""

from __future__ import annotations

import math
import random
from collections import deque
from dataclasses import dataclass

from robot_offload.errors import InputError

MSS = 1448
"""Bytes of a TCP segment on Ethernet with time stamps (1500 - 20 - 32)."""

MIN_RTO_S = 0.2
"""Linux's shortest retransmission time-out (TCP_RTO_MIN)."""

MAX_RTO_S = 60.0
"""Where the doubling ends; RFC 6298 section 2.5 allows a bound of at least 60 s."""

DUPLICATE_ACKS = 3
"""Segments after a hole that start a fast retransmission (RFC 5681 section 3.2)."""


class WireError(InputError, ValueError):
    """The emulated link cannot do what it was asked; the message states what to write instead."""


class ConditionsError(WireError):
    """Link conditions out of range."""


@dataclass(frozen=True)
class LinkConditions:
    """The state of one direction of the link.

    Attributes:
        delay_ms: one-way delay.
        jitter_ms: standard deviation of the normally distributed part of the delay; the sum is never
            negative.
        loss: share of packets lost, 0..1. A TCP stream is delayed by a retransmission instead.
        rate_kbit_s: rate at which the queue in front of the link drains, 0 = unlimited.
        queue_ms: a datagram that would wait longer in that queue is dropped (tail drop); 0 = endless.
        reorder: datagrams may overtake each other by jitter; otherwise the link keeps order like a radio
            queue. Streams are never reordered.
        cut: nothing passes: datagrams are dropped, streams are held and retransmitted with back-off.
    """

    delay_ms: float = 0.0
    jitter_ms: float = 0.0
    loss: float = 0.0
    rate_kbit_s: float = 0.0
    queue_ms: float = 0.0
    reorder: bool = False
    cut: bool = False

    def __post_init__(self) -> None:
        for name in ("delay_ms", "jitter_ms", "rate_kbit_s", "queue_ms"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0):
                raise ConditionsError(f"{name} must be a number of at least 0, found {value!r}")
        if not 0 <= self.loss <= 1:
            raise ConditionsError(f"loss must be a share from 0 to 1, found {self.loss!r}")

    def combined(self, other: LinkConditions) -> LinkConditions:
        """Return both in a row: delays add, independent jitters and losses combine, the narrower rate counts."""
        if self is CLEAR or other is CLEAR:
            return self if other is CLEAR else other
        narrow = self
        if other.rate_kbit_s and not 0 < self.rate_kbit_s <= other.rate_kbit_s:
            narrow = other
        return LinkConditions(
            delay_ms=self.delay_ms + other.delay_ms,
            jitter_ms=math.hypot(self.jitter_ms, other.jitter_ms),
            loss=1 - (1 - self.loss) * (1 - other.loss),
            rate_kbit_s=narrow.rate_kbit_s,
            queue_ms=narrow.queue_ms,
            reorder=self.reorder or other.reorder,
            cut=self.cut or other.cut,
        )


CLEAR = LinkConditions()
"""A direction that does nothing; the neutral element of `combined`."""


class DirectionModel:
    """One direction: decides when each packet arrives, or that it does not.

    The same seed and the same offers give the same decisions: two numbers are drawn for every packet,
    whatever the conditions, so that a changed delay does not change which packets are lost.
    """

    def __init__(self, seed: int, direction: str) -> None:
        self._random = random.Random(f"{seed}:{direction}")
        self._queue_free_s = -math.inf
        self._last_arrival_s = -math.inf

    def datagram(self, now_s: float, size: int, here: LinkConditions) -> float | None:
        """Offer a datagram.

        Args:
            now_s: when it is sent.
            size: bytes, for the rate.
            here: the conditions of this moment.

        Returns:
            When it arrives; None when it is lost.
        """
        luck, swing = self._random.random(), self._random.gauss(0.0, 1.0)
        if here.cut:
            return None
        if here.rate_kbit_s and here.queue_ms and self.backlog_s(now_s) * 1000 > here.queue_ms:
            return None
        sent_s = self.enqueue(now_s, size, here)
        # A packet lost in the air has still used its share of the rate.
        return None if luck < here.loss else self.arrival(sent_s, here, swing)

    def backlog_s(self, now_s: float) -> float:
        """Return how long a packet offered now would wait in the queue."""
        return max(0.0, self._queue_free_s - now_s)

    def enqueue(self, now_s: float, size: int, here: LinkConditions) -> float:
        """Pass `size` bytes through the queue; return when the last of them has left it."""
        if not here.rate_kbit_s:
            return now_s
        self._queue_free_s = max(self._queue_free_s, now_s) + size * 8 / (here.rate_kbit_s * 1000)
        return self._queue_free_s

    def arrival(self, sent_s: float, here: LinkConditions, swing: float) -> float:
        """Return when a packet arrives that leaves the queue at `sent_s`.

        Args:
            sent_s: when it leaves the queue.
            here: the conditions of this moment.
            swing: a number of the standard normal distribution.
        """
        at_s = sent_s + max(0.0, here.delay_ms + swing * here.jitter_ms) / 1000
        if here.reorder:
            return at_s
        self._last_arrival_s = max(self._last_arrival_s, at_s)
        return self._last_arrival_s

    def segments(self, count: int, here: LinkConditions) -> tuple[bool, float]:
        """Draw for `count` segments sent together: whether one is lost, and their swing."""
        luck, swing = self._random.random(), self._random.gauss(0.0, 1.0)
        return luck < 1 - (1 - here.loss) ** count, swing


class StreamModel:
    """One direction of one TCP connection: in order, nothing lost, but held up behind each hole.

    A lost segment is sent again after one round trip if enough follows it (fast retransmission), else after
    max(200 ms, 2 round trips). Each failed retransmission, as in a cut, doubles that wait. Bytes offered
    meanwhile wait behind the hole and arrive with it.
    """

    def __init__(self, direction: DirectionModel) -> None:
        self._direction = direction
        self._recent_s: deque[float] = deque(maxlen=DUPLICATE_ACKS)
        self._last_arrival_s = -math.inf
        self._next_timeout_s = 0.0
        self.retry_at_s: float | None = None
        """When the hole is sent again, by calling `retry`; None while nothing is missing."""
        self.retransmissions = 0

    def offer(self, now_s: float, size: int, here: LinkConditions, round_trip_s: float) -> float | None:
        """Offer bytes of the stream.

        Args:
            now_s: when they are sent.
            size: how many; 0 (opening, closing) is a segment of its own.
            here: the conditions of this moment.
            round_trip_s: the round-trip time of this moment, for the time-outs.

        Returns:
            When they arrive; None when they wait for `retry_at_s`.
        """
        count = max(1, math.ceil(size / MSS))
        busy = len(self._recent_s) == DUPLICATE_ACKS and now_s - self._recent_s[0] <= round_trip_s
        self._recent_s.append(now_s)
        if self.retry_at_s is not None:
            return None
        sent_s = self._direction.enqueue(now_s, size, here)
        lost, swing = self._direction.segments(count, here)
        if not (lost or here.cut):
            return self._arrival(sent_s, here, swing)
        timeout_s = max(MIN_RTO_S, 2 * round_trip_s)
        fast = not here.cut and (busy or count > DUPLICATE_ACKS)
        self.retry_at_s = sent_s + (round_trip_s if fast else timeout_s)
        self._next_timeout_s = timeout_s if fast else min(MAX_RTO_S, 2 * timeout_s)
        return None

    def retry(self, now_s: float, size: int, here: LinkConditions) -> float | None:
        """Send the hole again, at `retry_at_s`; if that gets through, all that waits behind it follows.

        Args:
            now_s: the present.
            size: bytes of all that waits.
            here: the conditions of this moment.

        Returns:
            When everything that waits arrives; None when it was lost again, with a new `retry_at_s`.
        """
        self.retransmissions += 1
        lost, swing = self._direction.segments(1, here)
        if lost or here.cut:
            self.retry_at_s = now_s + self._next_timeout_s
            self._next_timeout_s = min(MAX_RTO_S, 2 * self._next_timeout_s)
            return None
        self.retry_at_s = None
        return self._arrival(self._direction.enqueue(now_s, size, here), here, swing)

    def _arrival(self, sent_s: float, here: LinkConditions, swing: float) -> float:
        at_s = self._direction.arrival(sent_s, here, swing)
        self._last_arrival_s = max(self._last_arrival_s, at_s)
        return self._last_arrival_s
