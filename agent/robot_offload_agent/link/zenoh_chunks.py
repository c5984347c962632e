"""The chunks of large messages in one Zenoh session: keys, publishers, the sending thread; `chunks.py` decides.

A chunk is a put under a key of the link's own: its attachment is its place and the header. The receiver acknowledges
each.
"""

from __future__ import annotations

import logging
import secrets
import threading
from collections.abc import Callable, Collection
from typing import Any, Protocol

import zenoh

from robot_offload_agent.link.chunks import GIVE_UP_S, STALL_S, Assembly, ChunkSender, read_receipt, receipt
from robot_offload_agent.runtime.clock import now_s

log = logging.getLogger(__name__)

PART = "_part"
RECEIPTS = "_part_ack"


Declare = Callable[[str, Callable[[zenoh.Sample], None]], Any]
"""(key, callback): declares a subscriber of the session."""
OnWhole = Callable[[str, bytes, bytes], None]


class Publish(Protocol):
    """Declares a publisher under a key of the session."""

    def __call__(self, own_key: str, *, reliable: bool, priority: zenoh.Priority) -> zenoh.Publisher:
        """Return the publisher."""


class ChunkLane:
    """Sends and receives the large messages of a session.

    Attributes:
        malformed: how many invalid messages arrived.
    """

    def __init__(self, prefix: str, publish: Publish, on_room: Callable[[str], None]) -> None:
        """Start nothing yet.

        Args:
            prefix: of this side's keys in the session.
            publish: declares a publisher.
            on_room: called with a channel that has refused a message and would take one again.
        """
        self.malformed = 0
        self._prefix = prefix
        self._publish = publish
        self._on_room = on_room
        self._change = threading.Condition()
        self._senders: dict[str, ChunkSender] = {}
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._assemblies: dict[str, Assembly] = {}
        self._receipts: zenoh.Publisher | None = None
        self._thread: threading.Thread | None = None
        self._closing = False

    def hear(self, declare: Declare, others: str, channels: Collection[str], on_whole: OnWhole) -> Any:
        """Declare the subscriber of the other side's chunks.

        Args:
            declare: declares a subscriber of the session.
            others: prefix of the other side's keys.
            channels: names of the existing channels.
            on_whole: called with channel, header and payload of a whole message, on one thread for all channels.
        """
        self._assemblies = {name: Assembly() for name in channels}
        self._receipts = self._publish(f"{self._prefix}/{RECEIPTS}", reliable=True, priority=zenoh.Priority.REAL_TIME)
        start = len(f"{others}/{PART}/")

        def receive(sample: zenoh.Sample) -> None:
            self._receive(str(sample.key_expr)[start:], sample, on_whole)

        return declare(f"{others}/{PART}/**", receive)

    def hear_receipts(self, declare: Declare, others: str) -> Any:
        """Declare the subscriber of the other side's acknowledgements."""
        return declare(f"{others}/{RECEIPTS}", self._acknowledged)

    def send(self, channel: str, header: bytes, payload: bytes) -> bool:
        """Take a large message, and send it from a thread of its own; return False while another one is on its way."""
        with self._change:
            sender = self._senders.get(channel)
            if sender is None:
                sender = self._senders[channel] = ChunkSender(secrets.randbits(32))
                key = f"{self._prefix}/{PART}/{channel}"
                self._publishers[channel] = self._publish(key, reliable=True, priority=zenoh.Priority.BACKGROUND)
            taken = sender.offer(header, payload, now_s())
            if self._thread is None and not self._closing:
                self._thread = threading.Thread(target=self._run, name="link-chunks", daemon=True)
                self._thread.start()
            self._change.notify_all()
        return taken

    def is_busy(self, channel: str) -> bool:
        """Return whether a large message of a channel is on its way: no part of it may be overtaken."""
        sender = self._senders.get(channel)
        if sender is None:
            return False
        with self._change:
            return sender.is_busy()

    def close(self) -> None:
        """End the thread; return at once."""
        with self._change:
            self._closing = True
            self._change.notify_all()

    # -- the thread ---------------------------------------------------------------------------------------------------

    def _run(self) -> None:
        while not self._closing:
            with self._change:
                due = [(name, chunk) for name in self._senders if (chunk := self._next(name)) is not None]
                if not due:
                    busy = any(sender.present is not None for sender in self._senders.values())
                    self._change.wait(STALL_S if busy else None)
            for channel, (attachment, payload) in due:
                try:
                    self._publishers[channel].put(payload, attachment=attachment)
                except zenoh.ZError:
                    return  # the session has ended

    def _next(self, channel: str) -> tuple[bytes, bytes] | None:
        """Return the chunk of a channel to send now; call with _change held."""
        sender = self._senders[channel]
        given_up = sender.given_up
        chunk = sender.next(now_s())
        if sender.given_up > given_up:
            log.warning("Gave up a large message of %s: nothing of it was acknowledged for %g s", channel, GIVE_UP_S)
        return chunk

    # -- on threads of the wheel --------------------------------------------------------------------------------------

    def _receive(self, channel: str, sample: zenoh.Sample, on_whole: OnWhole) -> None:
        attachment = b"" if sample.attachment is None else sample.attachment.to_bytes()
        try:
            whole = self._assemblies[channel].take(attachment, sample.payload.to_bytes())
        except (ValueError, KeyError) as error:
            log.debug("Dropped a chunk of channel %s: %s", channel, error)
            self.malformed += 1
            return
        assert self._receipts is not None
        try:
            self._receipts.put(receipt(attachment, channel))
        except zenoh.ZError:
            return  # the session is being closed
        if whole is not None:
            on_whole(channel, *whole)

    def _acknowledged(self, sample: zenoh.Sample) -> None:
        try:
            number, index, channel = read_receipt(sample.payload.to_bytes())
        except ValueError:
            self.malformed += 1
            return
        with self._change:
            sender = self._senders.get(channel)
            has_room = sender is not None and sender.acknowledged(number, index, now_s())
            self._change.notify_all()
        if has_room:
            self._on_room(channel)
