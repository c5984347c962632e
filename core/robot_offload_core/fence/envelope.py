"""The header of every message that the agents carry: its sender, its order and its age.

Fixed binary layout (big endian), 60 bytes: magic and version 3, flags 1, robot incarnation 16, epoch 8, cloud
incarnation 16, sequence 8, echo reference 8. The only flag, 1, marks a latched message. On Zenoh the header is the
attachment, on DDS transports it precedes the payload.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from robot_offload_core.fence.token import Token

MAGIC = b"RO1"
LATCHED = 1
LAYOUT = struct.Struct(">3sB16sQ16sQQ")
ABSENT = bytes(16)


class EnvelopeError(ValueError):
    """The bytes are not a valid envelope header."""


@dataclass(frozen=True)
class Envelope:
    """The header of one message.

    Attributes:
        token: the sender's token when it sent. Inputs to the cloud carry the robot's view; epoch 0 is allowed there.
        sequence: grows by one with every message of one output (or input) under one token.
        echo_us: send time of the newest beat of the *receiver* that the sender had heard, on the receiver's clock;
            0 for none. The receiver's present time minus this is an upper bound of the age, so that no clocks of two
            hosts are compared.
        latched: the last value of a topic that is seldom published: it is valid at any age.
    """

    token: Token
    sequence: int
    echo_us: int
    latched: bool = False

    def age_s(self, now_s: float) -> float:
        """Return an upper bound of the age at the receiver's `now_s`; infinite if the sender had heard no beat."""
        return now_s - self.echo_us / 1e6 if self.echo_us else float("inf")


def encode(envelope: Envelope) -> bytes:
    """Encode a header."""
    token = envelope.token
    robot = bytes.fromhex(token.robot) if token.robot else ABSENT
    cloud = bytes.fromhex(token.cloud) if token.cloud else ABSENT
    flags = LATCHED if envelope.latched else 0
    return LAYOUT.pack(MAGIC, flags, robot, token.epoch, cloud, envelope.sequence, envelope.echo_us)


def decode(data: bytes) -> Envelope:
    """Decode a header; raise EnvelopeError if the bytes are not a valid one."""
    if len(data) != LAYOUT.size:
        raise EnvelopeError(f"{len(data)} bytes instead of {LAYOUT.size}")
    magic, flags, robot, epoch, cloud, sequence, echo_us = LAYOUT.unpack(data)
    if magic != MAGIC or flags not in (0, LATCHED):
        raise EnvelopeError("not an envelope of this version")
    token = Token("" if robot == ABSENT else robot.hex(), epoch, "" if cloud == ABSENT else cloud.hex())
    return Envelope(token, sequence, echo_us, flags == LATCHED)
