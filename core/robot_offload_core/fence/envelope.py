"""The header that travels with every message the agents carry: who sent it, in which order, and how old it is.

Fixed binary layout (big endian), 60 bytes: magic and version 3, flags 1, robot incarnation 16, epoch 8, cloud
incarnation 16, sequence 8, echo reference 8. The one flag, 1, says that the message is latched. On Zenoh the header is
the attachment, on DDS transports it precedes the payload.
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
    """Bytes that are no envelope header of ours."""


@dataclass(frozen=True)
class Envelope:
    """The header.

    Attributes:
        token: of the sender when it sent. Inputs to the cloud carry the robot's view; epoch 0 is allowed there.
        sequence: grows by one with every message of one output (or input) under one token.
        echo_us: send time of the newest beat of the *receiver* that the sender had heard, on the receiver's clock;
            0 for none. Receiver's now minus this is an upper bound of the age: no clocks of two hosts are compared.
        latched: the last value of a topic that speaks seldom: it holds whatever its age.
    """

    token: Token
    sequence: int
    echo_us: int
    latched: bool = False

    def age_s(self, now_s: float) -> float:
        """Upper bound of the message's age at `now_s` of the receiver; infinite when nothing had been heard."""
        return now_s - self.echo_us / 1e6 if self.echo_us else float("inf")


def encode(envelope: Envelope) -> bytes:
    """Return the header's bytes."""
    token = envelope.token
    robot = bytes.fromhex(token.robot) if token.robot else ABSENT
    cloud = bytes.fromhex(token.cloud) if token.cloud else ABSENT
    flags = LATCHED if envelope.latched else 0
    return LAYOUT.pack(MAGIC, flags, robot, token.epoch, cloud, envelope.sequence, envelope.echo_us)


def decode(data: bytes) -> Envelope:
    """Read a header; raise EnvelopeError."""
    if len(data) != LAYOUT.size:
        raise EnvelopeError(f"{len(data)} bytes instead of {LAYOUT.size}")
    magic, flags, robot, epoch, cloud, sequence, echo_us = LAYOUT.unpack(data)
    if magic != MAGIC or flags not in (0, LATCHED):
        raise EnvelopeError("not an envelope of this version")
    token = Token("" if robot == ABSENT else robot.hex(), epoch, "" if cloud == ABSENT else cloud.hex())
    return Envelope(token, sequence, echo_us, flags == LATCHED)
