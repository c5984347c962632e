"""One open Zenoh session: publishers and subscribers of all channels, acknowledgements of bulk.

On the wire a message is a put: the payload is the payload, the attachment is a sequence (4 bytes, big-endian) and the
header. A sequence other than 0 asks for an acknowledgement: a put whose payload is that sequence and the channel.
What is too large for that crosses in chunks, see `zenoh_chunks.py`.
"""

from __future__ import annotations

import json
import logging
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import zenoh

from robot_offload_agent.link.chunks import WHOLE_BYTES
from robot_offload_agent.link.port import Channel, OnRoom, no_room
from robot_offload_agent.link.zenoh_chunks import ChunkLane
from robot_offload_agent.link.zenoh_config import (
    BULK_BYTES,
    UID_KEY,
    ZenohSettings,
    acknowledgement_key,
    key,
    key_prefix,
    session_config,
)
from robot_offload_agent.link.zenoh_rules import Backlog, Peer, robots
from robot_offload_agent.runtime.clock import now_s
from robot_offload_core.words.declared import Priority

log = logging.getLogger(__name__)

_SEQUENCE_BYTES = 4
_SMALL = {
    Priority.HIGH: zenoh.Priority.DATA_HIGH, Priority.NORMAL: zenoh.Priority.DATA, Priority.LOW: zenoh.Priority.DATA
}  # fmt: skip
_BULK = {
    Priority.HIGH: zenoh.Priority.DATA, Priority.NORMAL: zenoh.Priority.DATA_LOW,
    Priority.LOW: zenoh.Priority.BACKGROUND,
}  # fmt: skip
"""Priority of what does not fit a datagram: behind all that does, unless it was declared to go first."""


def _priority(channel: Channel) -> zenoh.Priority:
    """Return the queue of a channel's small messages."""
    return zenoh.Priority.REAL_TIME if channel.urgent else _SMALL[channel.priority]


class PeerRefusedError(Exception):
    """The answering side's certificate is not the cloud's."""


@dataclass
class _Outlet:
    """The sending end of a channel.

    Attributes:
        publisher: of messages that fit in a datagram.
        bulk: publisher of bigger ones, behind all others; None if all go the same way.
        backlog: of the bulk.
        is_bulk: a message was too big once: from then on all go one way, so that none overtakes another.
    """

    publisher: zenoh.Publisher
    bulk: zenoh.Publisher | None
    backlog: Backlog
    is_bulk: bool = False


class ZenohSession:
    """A session that is open from construction to `close`.

    Attributes:
        fallback: the robot dialled the fallback.
        connections: to the other side, now; clients with another certificate do not count, nor does a robot's second
            one for large messages. A robot's is 1 and then 0 for ever: nothing reconnects within a session.
        opened: how many connections there have been.
        received: how many messages of the other side arrived.
        served_uid: the uid that the cloud serves, if it has stated it: it does to a robot that is silent under that
            uid.
        strangers: common names of the certificates of the others that are connected, "" for none.
        foreign: how many connections such clients have had.
        on_room: see `port.OnRoom`.
    """

    def __init__(self, settings: ZenohSettings, fallback: bool = False, open_timeout_ms: int | None = None) -> None:
        """Open it; blocks for up to `open_timeout_ms`, longer only while a name is looked up.

        Args:
            settings: of the link.
            fallback: whether to dial the fallback.
            open_timeout_ms: of this attempt; None: that of the settings.

        Raises:
            zenoh.ZError: there was no answer, or the port to listen on is taken.
            PeerRefusedError: the answer was not from the cloud.
        """
        self.settings = settings
        self.fallback = fallback
        self.connections = self.opened = 0
        self._malformed = 0
        self.received = 0
        self.served_uid = ""
        self.strangers: frozenset[str] = frozenset()
        self.foreign = 0
        self.on_room: OnRoom = no_room
        self._peers: dict[str, Peer] = {}  # of the cloud, by session
        self._outlets: dict[str, _Outlet] = {}
        self._lock = threading.Lock()
        self._declared: list[Any] = []
        self._chunks = ChunkLane(key_prefix(settings, settings.side), self._publish, self._say_room)
        config = session_config(settings, fallback=fallback, open_timeout_ms=open_timeout_ms)
        self._session = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
        try:
            self._check_peer()
        except (PeerRefusedError, zenoh.ZError):
            self.close()
            raise

    def _check_peer(self) -> None:
        if not self.settings.dials or self.settings.verify_name:
            return
        found = {link.auth_identifier for link in self._session.info.links()}
        if found != {self.settings.peer_name}:
            shown = ", ".join(sorted(name or "none" for name in found)) or "none"
            raise PeerRefusedError(f"its certificate names {shown}, not {self.settings.peer_name}")

    def protocols(self) -> set[str]:
        """Return the protocols of the present connections: `quic`, `tls`, or none."""
        try:
            return {link.src.partition("/")[0] for link in self._session.info.links()}
        except zenoh.ZError:
            return set()

    def declare(
        self,
        channels: Sequence[Channel],
        on_message: Callable[[ZenohSession, str, bytes, bytes], None],
        on_connection: Callable[[ZenohSession], None],
    ) -> None:
        """Declare all channels.

        Args:
            channels: the same as on the other side.
            on_message: called with (self, channel, header, payload) on a thread of the channel.
            on_connection: called with (self) on a thread of its own after `connections` has changed.

        Raises:
            zenoh.ZError: the session has ended.
        """
        settings = self.settings
        self._declare_outlets(channels)
        if settings.session == "data":
            others = key_prefix(settings, settings.other_side)

            def put_together(channel: str, header: bytes, payload: bytes) -> None:
                self.received += 1
                on_message(self, channel, header, payload)

            names = [channel.name for channel in channels]
            self._declared.append(self._chunks.hear(self._session.declare_subscriber, others, names, put_together))
        for channel in channels:

            def receive(sample: zenoh.Sample, name: str = channel.name) -> None:
                self._receive(name, sample, on_message)

            heard = key(settings, settings.other_side, channel.name)
            self._declared.append(self._session.declare_subscriber(heard, receive))

        if settings.dials:
            self._declared.append(self._session.declare_subscriber(UID_KEY, self._introduced))
        else:
            self._introduction = self._publish(UID_KEY, reliable=True)
        self._attend(on_connection)

    def speak(self, channels: Sequence[Channel], on_connection: Callable[[ZenohSession], None]) -> None:
        """Declare all channels for sending only: beside another session that receives.

        Args:
            channels: the same as on the other side.
            on_connection: see `declare`.

        Raises:
            zenoh.ZError: the session has ended.
        """
        self._declare_outlets(channels)
        self._attend(on_connection)

    def _declare_outlets(self, channels: Sequence[Channel]) -> None:
        settings = self.settings
        for channel in channels:
            self._outlets[channel.name] = self._make_outlet(channel)
        others = key_prefix(settings, settings.other_side)
        if settings.session == "data":
            self._declared.append(self._chunks.hear_receipts(self._session.declare_subscriber, others))
        # Reliable: if the newest counts, a lost one would hold up its channel for the whole lease.
        self._acknowledgements = self._publish(
            acknowledgement_key(settings, settings.side), reliable=True, priority=zenoh.Priority.REAL_TIME
        )
        heard = acknowledgement_key(settings, settings.other_side)
        self._declared.append(self._session.declare_subscriber(heard, self._acknowledged))

    def _attend(self, on_connection: Callable[[ZenohSession], None]) -> None:
        """Follow which clients connect and leave."""
        settings = self.settings

        def changed(event: Any) -> None:
            up = event.kind == zenoh.SampleKind.PUT
            if settings.dials:
                if up:
                    return  # the one it was opened with
                self.connections = 0
            else:
                self._count_peer(str(event.transport.zid), up)
            on_connection(self)

        if settings.dials:
            self.connections = self.opened = 1
        self._declared.append(self._session.info.declare_transport_events_listener(changed, history=True))
        if settings.dials and not self.protocols():
            self.connections = 0  # lost before anybody listened

    def _count_peer(self, session: str, up: bool) -> None:
        """Record that a client connected to the cloud or left."""
        known = (self.settings.peer_name, *self.settings.observers)
        if up:
            links = [link for link in self._session.info.links() if str(link.zid) == session]
            name = min((link.auth_identifier or "" for link in links), default="")
            protocol = min((link.src.partition("/")[0] for link in links), default="")
            self._peers[session] = Peer(name, protocol)
            self.opened += name == self.settings.peer_name
            self.foreign += name not in known
        else:
            self._peers.pop(session, None)
        self.connections = robots(peer for peer in self._peers.values() if peer.name == self.settings.peer_name)
        self.strangers = frozenset(peer.name for peer in self._peers.values() if peer.name not in known)

    def introduce(self) -> None:
        """Send the uid that the cloud serves."""
        try:
            self._introduction.put(self.settings.uid)
        except zenoh.ZError as error:
            log.debug("Saying whom this cloud serves failed: %s", error)

    def _introduced(self, sample: zenoh.Sample) -> None:
        self.served_uid = sample.payload.to_bytes().decode(errors="replace")[:63]

    def _make_outlet(self, channel: Channel) -> _Outlet:
        settings = self.settings
        own_key = key(settings, settings.side, channel.name)
        reliable = channel.reliable and settings.session == "data"
        parted = settings.session == "data" and not channel.urgent
        return _Outlet(
            publisher=self._publish(own_key, reliable=reliable, priority=_priority(channel)),
            # Reliable even if the channel is not: QUIC keeps datagrams that it cannot send, a megabyte of them, and one
            # lost fragment costs the whole message.
            bulk=self._publish(own_key, reliable=True, priority=_BULK[channel.priority]) if parted else None,
            backlog=Backlog(settings.backlog_ms / 1e3, settings.lease_ms / 1e3, channel.latest),
        )

    def _publish(
        self, own_key: str, *, reliable: bool = False, priority: zenoh.Priority = zenoh.Priority.DATA
    ) -> zenoh.Publisher:
        return self._session.declare_publisher(
            own_key,
            reliability=zenoh.Reliability.RELIABLE if reliable else zenoh.Reliability.BEST_EFFORT,
            congestion_control=zenoh.CongestionControl.DROP,  # BLOCK holds a sender up for seconds
            priority=priority,
            express=True,
        )

    def send(self, channel: str, header: bytes, payload: bytes) -> bool:
        """Put a message; return False if it was certainly not sent.

        Raises:
            KeyError: no such channel is declared.
        """
        outlet = self._outlets[channel]
        publisher, sequence = outlet.publisher, 0
        outlet.is_bulk = outlet.is_bulk or len(header) + len(payload) > BULK_BYTES
        if outlet.bulk is not None and len(payload) > WHOLE_BYTES:
            return self._chunks.send(channel, header, payload)
        if self._chunks.is_busy(channel):
            return False
        if outlet.bulk is not None and outlet.is_bulk:
            with self._lock:
                admitted = outlet.backlog.admit(now_s())
            if admitted is None:
                return False
            publisher, sequence = outlet.bulk, admitted
        try:
            publisher.put(payload, attachment=sequence.to_bytes(_SEQUENCE_BYTES, "big") + header)
        except zenoh.ZError:
            return False
        return True

    def _receive(
        self, channel: str, sample: zenoh.Sample, on_message: Callable[[ZenohSession, str, bytes, bytes], None]
    ) -> None:
        attachment = b"" if sample.attachment is None else sample.attachment.to_bytes()
        if len(attachment) < _SEQUENCE_BYTES:
            self._malformed += 1
            return
        self.received += 1
        sequence, header = attachment[:_SEQUENCE_BYTES], attachment[_SEQUENCE_BYTES:]
        if any(sequence):
            try:
                self._acknowledgements.put(sequence + channel.encode())
            except zenoh.ZError:
                return  # the session is being closed
        on_message(self, channel, header, sample.payload.to_bytes())

    def _acknowledged(self, sample: zenoh.Sample) -> None:
        payload = sample.payload.to_bytes()
        outlet = self._outlets.get(payload[_SEQUENCE_BYTES:].decode(errors="replace"))
        if outlet is None:
            self._malformed += 1
            return
        with self._lock:
            has_room = outlet.backlog.acknowledged(int.from_bytes(payload[:_SEQUENCE_BYTES], "big"), now_s())
        if has_room:
            self.on_room(payload[_SEQUENCE_BYTES:].decode())

    def _say_room(self, channel: str) -> None:
        self.on_room(channel)

    @property
    def malformed(self) -> int:
        """Return how many invalid messages arrived."""
        return self._malformed + self._chunks.malformed

    def close(self) -> None:
        """Close it with everything buffered in it; may take 20 s if TLS has data that it cannot send."""
        self._chunks.close()
        try:
            self._session.close()  # type: ignore[no-untyped-call]  # the wheel does not annotate it
        except zenoh.ZError as error:
            log.debug("Closing a session failed: %s", error)
