"""The port behind which a link hides: named channels of bytes between the robot's and the cloud's agent.

Two implementations: `zenoh.py` (the agents' own session) and `ros.py` (topics over whatever DDS transport joins the
two sides). Nothing here knows what the bytes mean; a link never judges freshness, tokens or ages.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from robot_offload_core.words.declared import Priority
from robot_offload_core.words.reasons import Explained

OnMessage = Callable[[str, bytes, bytes], None]
"""(channel, header, payload), called on a thread of the link as soon as a message has arrived; must not block."""
OnRoom = Callable[[str], None]
"""(channel), called on a thread of the link when a channel that has refused a message takes one again."""


def no_room(_: str) -> None:
    """Serve as an `OnRoom` where nothing waits."""


@dataclass(frozen=True)
class Channel:
    """One named stream of messages; both ends declare the same channels.

    Attributes:
        name: unique in the session, e.g. `beat`, `probe`, `in/scan`, `out/cmd_vel`.
        reliable: whether the transport retransmits. Reliable does not mean delivered: a message put while the
            session is down is lost.
        urgent: sent before everything else (beats, probes).
        priority: which of the others go first.
        latest: few messages are on their way at a time, so that the next one is new when it leaves.
    """

    name: str
    reliable: bool = True
    urgent: bool = False
    priority: Priority = Priority.NORMAL
    latest: bool = False


class LinkCause(Explained):
    """Why there is no proper session."""

    NONE = "", "All is well"
    NO_SESSION = "NoSession", "A session does not come about, for a cause that is not known", "Read the message"
    UNKNOWN_NAME = "UnknownName", "The cloud's name cannot be looked up", "Check the name, and the robot's DNS"
    NO_ANSWER = (
        "NoAnswer", "The cloud's address does not answer", "Check the address, the ports and the firewalls on the way"
    )  # fmt: skip
    UDP_BLOCKED = (
        "UdpBlocked", "Only TLS over TCP gets through; the link works with it", "Open the UDP ports on the way"
    )  # fmt: skip
    CERTIFICATE_REFUSED = (
        "CertificateRefused", "One side refuses the other's certificate: revoked, ended, or of another authority",
        "Write the robot's bundle again",
    )  # fmt: skip
    CERTIFICATE_EXPIRED = (
        "CertificateExpired", "The cloud's certificate is not valid at the robot's time of day",
        "Check the robot's clock",
    )  # fmt: skip
    CERTIFICATE_FILES = (
        "CertificateFiles", "A certificate file is missing, unreadable, or does not fit", "Write the bundle again"
    )  # fmt: skip
    WRONG_AUTHORITY = (
        "WrongAuthority", "Who answers is not this robot's cloud, or its authority is newer than the bundle",
        "Check the address, then write the bundle again",
    )  # fmt: skip
    WRONG_NAME = (
        "WrongName", "The cloud's certificate is for another host", "Dial that host, or correct `expose.host`"
    )  # fmt: skip
    OTHER_IDENTITY = (
        "OtherIdentity", "Robot and cloud belong to different RobotOffloads: the resource was made anew",
        "Write the robot's bundle again",
    )  # fmt: skip
    STRANGER = (
        "Stranger", "A certificate of the same issuer for another robot is connected; it says and hears nothing",
        "See that each robot has its own bundle",
    )  # fmt: skip
    SECOND_SESSION = (
        "SecondSession", "Two sessions show this robot's certificate: a second agent, or a copy of the key",
        "End the second agent, or revoke the certificate",
    )  # fmt: skip
    CANNOT_LISTEN = "CannotListen", "The cloud's agent cannot listen on its port", "See what else uses the port"


@dataclass(frozen=True)
class LinkStatus:
    """The state of a link.

    Attributes:
        connected: a session with the other side is open. This does not mean that data are fresh; beats show that.
        endpoint: the endpoint in use or being tried, e.g. `quic/cloud.example:7447`; empty for DDS.
        fallback: the endpoint is the fallback (TLS over TCP), with its longer limits.
        sessions: how many sessions were opened since the start; grows with every reconnect.
        message: the problem and the next step, for people; empty if there is none.
        cause: of the problem in `message`.
        counters: (name, count) of what happened since the start and should not.
    """

    connected: bool
    endpoint: str = ""
    fallback: bool = False
    sessions: int = 0
    message: str = ""
    cause: LinkCause = LinkCause.NONE
    counters: tuple[tuple[str, int], ...] = ()


class Link(Protocol):
    """One end of one session."""

    def start(self) -> None:
        """Start connecting (robot) or listening (cloud) in the background and return at once."""

    def send(self, channel: str, header: bytes, payload: bytes) -> bool:
        """Pass a message to the transport; never block longer than about 20 ms.

        Returns:
            False if it was certainly not sent (no session, queue full). True promises nothing.
        """

    def status(self) -> LinkStatus:
        """Return the present state; cheap, callable from any thread."""

    def reopen(self, reason: str) -> None:
        """Drop the session with everything buffered in it and open a new one from a new source port.

        Called at each dead verdict: only the end of a session discards stale samples in the transport, and stale
        connection tracking on the path is left behind. Returns at once; calls during a running reopen are ignored.
        """

    def close(self) -> None:
        """End the session and its threads for good."""
