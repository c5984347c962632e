"""The link as topics, over whatever DDS transport joins the two sides.

The beat is a std_msgs/Header on `/connectivity_test_local` (robot to cloud) and `/connectivity_test_remote` (cloud to
robot), its text in `frame_id`: names and type that other tools know. All other channels are std_msgs/UInt8MultiArray
on `/offload/link/<sender side>/<channel>`, its data a header length (2 bytes, big-endian), header and payload.

Both are read and written as serialized bytes: converting 10 KiB of uint8[] to Python integers costs milliseconds, and
invalid bytes are counted here instead of raising in the executor.
"""

from __future__ import annotations

import logging
import struct
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

from rclpy.impl.implementation_singleton import rclpy_implementation as rclpy_native
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from std_msgs.msg import Header, UInt8MultiArray

from robot_offload_agent.errors import ConfigurationError
from robot_offload_agent.link.port import Channel, LinkStatus, OnMessage
from robot_offload_agent.runtime.clock import now_s

log = logging.getLogger(__name__)

BEAT = "beat"
BEAT_TOPICS = {"robot": "/connectivity_test_local", "cloud": "/connectivity_test_remote"}
"""By the sender's side."""

_DEPTH = 10
_MATCHED_S = 0.1  # counting in the graph costs some 50 us for each topic; status() is asked for with every beat
_CDR = {b"\x00\x00": ">", b"\x00\x01": "<"}  # encapsulations of plain CDR: big-endian, little-endian


class MalformedError(ValueError):
    """Bytes that are not a message of this link."""


# -- serialized messages: OMG CDR as rmw hands it over, 4 bytes of encapsulation, then fields aligned to their size ----


def encode_beat(stamp_ns: int, text: bytes) -> bytes:
    """Return a serialized std_msgs/Header.

    Args:
        stamp_ns: the sender's system time.
        text: UTF-8; travels as frame_id.

    Raises:
        ValueError: the text holds a NUL, which ends a string.
    """
    if b"\0" in text:
        raise ValueError("a beat is text and holds no NUL")
    seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
    return b"\x00\x01\x00\x00" + struct.pack("<iII", seconds, nanoseconds, len(text) + 1) + text + b"\0"


def decode_beat(serialized: bytes) -> bytes:
    """Return the text in frame_id of a serialized std_msgs/Header; b"" is a bare beat.

    Raises:
        MalformedError: it is not a Header.
    """
    order = _order(serialized)
    if len(serialized) < 16:
        raise MalformedError("shorter than a stamp and a string")
    (length,) = struct.unpack_from(f"{order}I", serialized, 12)
    text = serialized[16 : 16 + length]
    if len(text) < length:
        raise MalformedError("the string ends beyond the message")
    return text[:-1] if text.endswith(b"\0") else text  # some writers count the NUL in, a few do not


def encode_frame(header: bytes, payload: bytes) -> bytes:
    """Return a serialized std_msgs/UInt8MultiArray without layout that holds header and payload.

    Raises:
        ValueError: the header is longer than 65535 bytes.
    """
    if len(header) > 0xFFFF:
        raise ValueError(f"the header is {len(header)} bytes long, 65535 is the most")
    size = 2 + len(header) + len(payload)
    return b"\x00\x01\x00\x00" + struct.pack("<III", 0, 0, size) + len(header).to_bytes(2, "big") + header + payload


def decode_frame(serialized: bytes) -> tuple[bytes, bytes]:
    """Return header and payload.

    Raises:
        MalformedError: these bytes do not come from `encode_frame`.
    """
    order = _order(serialized)
    if len(serialized) < 18:
        raise MalformedError("shorter than an empty message")
    dimensions, _offset, size = struct.unpack_from(f"{order}III", serialized, 4)
    if dimensions != 0:
        raise MalformedError("it has a layout")
    data = serialized[16 : 16 + size]
    if len(data) < size or size < 2:
        raise MalformedError("the data end beyond the message")
    begin = 2 + int.from_bytes(data[:2], "big")
    if begin > size:
        raise MalformedError("the header ends beyond the message")
    return data[2:begin], data[begin:]


def _order(serialized: bytes) -> str:
    order = _CDR.get(serialized[:2])
    if order is None:
        raise MalformedError("not plain CDR")
    return order


# -- the link ----------------------------------------------------------------------------------------------------------


def topic(sender_side: str, channel: str) -> str:
    """Return the topic on which a side sends a channel.

    Raises:
        ConfigurationError: the channel's name is not a valid topic.
    """
    if channel == BEAT:
        return BEAT_TOPICS[sender_side]
    word = channel.replace("/", "_")
    if not word.isascii() or not word.isidentifier():
        raise ConfigurationError(f"channel {channel!r}: use letters, digits and '_', and '/' between words")
    return f"/offload/link/{sender_side}/{word}"


class RosLink:
    """See `port.Link`. The caller spins the node; messages arrive on the thread that does.

    DDS has no session: what is buffered for a partner that is away is bounded by the depth (1 for the beat, else 10).

    Attributes:
        malformed: how many invalid messages arrived.
    """

    def __init__(self, node: Node, side: str, channels: Sequence[Channel], on_message: OnMessage) -> None:
        """Nothing is created in the graph yet.

        Raises:
            ConfigurationError: names of channels are not valid topics, or two of them give the same one.
        """
        self.malformed = 0
        self._node = node
        self._side = side
        self._other = "cloud" if side == "robot" else "robot"
        self._channels = {channel.name: channel for channel in channels}
        topics = {topic(side, channel.name) for channel in channels}
        if len(topics) != len(channels):
            raise ConfigurationError(f"channels {', '.join(c.name for c in channels)}: two of them share a topic")
        self._on_message = on_message
        self._publishers: dict[str, Publisher] = {}
        self._subscriptions: list[Subscription] = []
        self._lock = threading.Lock()
        self._connected = False
        self._sessions = 0
        self._counted_s = float("-inf")

    def start(self) -> None:
        """Create publishers and subscriptions."""
        for channel in self._channels.values():
            kind, depth = (Header, 1) if channel.name == BEAT else (UInt8MultiArray, _DEPTH)
            reliable = channel.reliable and channel.name != BEAT
            qos = QoSProfile(
                depth=depth,
                reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
            )
            heard = topic(self._other, channel.name)
            receive = self._receiver(channel.name)
            self._subscriptions.append(self._node.create_subscription(kind, heard, receive, qos, raw=True))
            self._publishers[channel.name] = self._node.create_publisher(kind, topic(self._side, channel.name), qos)

    def _receiver(self, name: str) -> Callable[[bytes], None]:
        def receive(serialized: bytes) -> None:
            try:
                header, payload = (b"", decode_beat(serialized)) if name == BEAT else decode_frame(serialized)
            except MalformedError as error:
                self.malformed += 1
                if self.malformed == 1:
                    log.warning("A message on channel %s is none of ours (%s), others are only counted", name, error)
                return
            try:
                self._on_message(name, header, payload)
            except Exception:
                log.exception("Handling a message of channel %s failed", name)

        return receive

    def send(self, channel: str, header: bytes, payload: bytes) -> bool:
        """Publish; return False if there is no subscriber.

        Raises:
            KeyError: no such channel.
            ValueError: a beat with a header or with a NUL, or a header of more than 65535 bytes.
        """
        if channel == BEAT:
            if header:
                raise ValueError("a beat has no header")
            serialized = encode_beat(time.clock_gettime_ns(time.CLOCK_REALTIME), payload)
        else:
            serialized = encode_frame(header, payload)
        self._channels[channel]
        publisher = self._publishers.get(channel)
        if publisher is None:
            return False
        try:
            if publisher.get_subscription_count() == 0:
                return False
            publisher.publish(serialized)
        except (rclpy_native.InvalidHandle, rclpy_native.RCLError):
            return False  # the node or its context has ended
        return True

    def status(self) -> LinkStatus:
        """Return whether every channel has a publisher and a subscriber on the other side."""
        with self._lock:
            now = now_s()
            if now - self._counted_s >= _MATCHED_S:
                self._counted_s = now
                before, self._connected = self._connected, self._matched()
                self._sessions += self._connected and not before
                if before != self._connected:
                    log.info("%s the other side's topics", "Found" if self._connected else "Lost")
            message = "" if self._connected else "the other side's topics are not all there"
            return LinkStatus(self._connected, sessions=self._sessions, message=message)

    def _matched(self) -> bool:
        try:
            return bool(self._publishers) and all(
                publisher.get_subscription_count() > 0 and self._node.count_publishers(topic(self._other, name)) > 0
                for name, publisher in list(self._publishers.items())
            )
        except (rclpy_native.InvalidHandle, rclpy_native.RCLError):
            return False

    def reopen(self, reason: str) -> None:
        """Do nothing: DDS has no session to drop."""
        log.debug("Reopened nothing, DDS has no session reason=%s", reason)

    def close(self) -> None:
        """Take the topics out of the graph."""
        publishers, self._publishers = self._publishers, {}
        subscriptions, self._subscriptions = self._subscriptions, []
        for publisher in publishers.values():
            _destroy(self._node.destroy_publisher, publisher)
        for subscription in subscriptions:
            _destroy(self._node.destroy_subscription, subscription)


def _destroy(destroy: Callable[[Any], bool], entity: Any) -> None:
    try:
        destroy(entity)
    except rclpy_native.InvalidHandle:
        log.debug("The node was destroyed before the link")
