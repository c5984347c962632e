"""Why there is no Zenoh session: the wheel's errors do not state it, the lines of its log do. Pure.

The lines are those of eclipse-zenoh 1.10; `tests/ros/test_link_zenoh_causes.py` provokes every one of them.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

from robot_offload_agent.link.port import LinkCause
from robot_offload_agent.link.zenoh_config import ZenohSettings

_COLOURS = re.compile(r"\x1b\[[0-9;]*m")
_SOURCE = re.compile(r"\.?\s+at /\S+\.rs:\d+.*$|\. Hint: .*$")
_DIALLED = re.compile(r"orchestrator: Unable to connect to ((?:quic|tls)/\S+?)(?:\?\S*)?! (.*)")
_LISTENED = re.compile(r"(?:QUIC acceptor failed: |zenoh_link_tls::unicast: )(.*)")
_CERTIFICATE = re.compile(r"invalid peer certificate: ([^\n]*?)(?:\"\s*\}\)|$)")

_NO_ANSWER = ("deadline has elapsed", "refused (os error", "unreachable", "No route to host", "timed out", "Timeout")
_UNKNOWN_NAME = ("failed to lookup address", "Could not resolve")
_REFUSED = ("aborted by peer", "received fatal alert")
_HANDSHAKE = ("invalid peer certificate", "fatal alert", "crypto(", "peer sent no certificates")
_TELLING = (
    LinkCause.CERTIFICATE_REFUSED, LinkCause.WRONG_AUTHORITY, LinkCause.WRONG_NAME, LinkCause.CERTIFICATE_EXPIRED,
    LinkCause.UNKNOWN_NAME, LinkCause.NO_SESSION, LinkCause.NO_ANSWER,
)  # fmt: skip
"""The most informative first: of several addresses one may be away and another refuse the connection."""


@dataclass(frozen=True)
class Found:
    """The meaning of one line of the wheel's log.

    Attributes:
        cause: of the failure.
        detail: in the wheel's words, short.
        endpoint: the dialled one; "" for an event at a listener.
    """

    cause: LinkCause
    detail: str
    endpoint: str = ""


def read_line(line: str) -> Found | None:
    """Return the meaning of a line about a session that did not come about, None for any other line."""
    text = _SOURCE.sub("", _COLOURS.sub("", line).strip())
    if (dialled := _DIALLED.search(text)) is not None:
        return Found(_dialled(dialled[2]), _short(dialled[2]), dialled[1])
    listened = _LISTENED.search(text)
    if listened is not None and any(words in listened[1] for words in _HANDSHAKE):
        ours = "ConnectionClosed" in text or "fatal alert" in text  # it is the other side that ended the handshake
        return Found(LinkCause.WRONG_AUTHORITY if ours else LinkCause.CERTIFICATE_REFUSED, _short(listened[1]))
    return None


def _dialled(why: str) -> LinkCause:
    if any(words in why for words in _REFUSED):
        return LinkCause.CERTIFICATE_REFUSED
    if "invalid peer certificate" in why:
        return _their_certificate(why)
    if any(words in why for words in _UNKNOWN_NAME):
        return LinkCause.UNKNOWN_NAME
    return LinkCause.NO_ANSWER if any(words in why for words in _NO_ANSWER) else LinkCause.NO_SESSION


def _their_certificate(why: str) -> LinkCause:
    if "not valid for name" in why:
        return LinkCause.WRONG_NAME
    return LinkCause.CERTIFICATE_EXPIRED if "expired" in why or "not valid yet" in why else LinkCause.WRONG_AUTHORITY


def _short(why: str) -> str:
    certificate = _CERTIFICATE.search(why)
    detail = certificate[1] if certificate is not None else why.rpartition(": ")[2]
    return detail.rstrip(". ")[:200]


def most_telling(found: Iterable[Found]) -> Found | None:
    """Return the most informative line on why an attempt failed, None without any."""
    return min(found, key=lambda one: _TELLING.index(one.cause), default=None)


def explain(found: Found, settings: ZenohSettings, where: str) -> str:
    """Return the sentence for people: the problem at `where`, and the next step."""
    if settings.dials:
        return f"No {settings.session} session with {where}: {_at_the_robot(found, settings)}"
    refused = found.cause is LinkCause.CERTIFICATE_REFUSED
    who = (
        f"Refused a robot at {where}: its certificate does not come from {settings.ca}, or has ended"
        if refused
        else f"A robot at {where} refuses this cloud's certificate: its bundle trusts another authority, or host name"
    )
    return f"{who} ({found.detail}); if it is this robot, write its bundle again"


def _at_the_robot(found: Found, settings: ZenohSettings) -> str:
    why = {
        LinkCause.UNKNOWN_NAME: "its name cannot be looked up here; check the name and this robot's DNS",
        LinkCause.NO_ANSWER: "the address does not answer; check it, the ports and the firewalls on the way",
        LinkCause.CERTIFICATE_REFUSED: f"the cloud refuses this robot's certificate {settings.certificate}: revoked, "
        "ended, or made for another cloud; write the bundle again",
        LinkCause.WRONG_AUTHORITY: f"who answers there does not have a certificate of {settings.ca}: another robot's "
        "cloud, or one whose authority is newer; check the address, then write the bundle again",
        LinkCause.WRONG_NAME: "the cloud's certificate is for another host; dial the host that it names, or correct "
        "spec.transport.expose.host",
        LinkCause.CERTIFICATE_EXPIRED: "the cloud's certificate is not valid at this time; check this robot's clock",
    }.get(found.cause, "no answer, or a certificate was refused")
    return f"{why} ({found.detail})" if found.detail else why


def other_identity(settings: ZenohSettings, cloud_uid: str) -> str:
    """Return the robot's sentence about a cloud that serves another RobotOffload."""
    return (
        f"This cloud serves the RobotOffload with uid {cloud_uid}, this robot's configuration is for {settings.uid}: "
        "the resource was made anew; write the bundle again"
    )


def silent_robot(settings: ZenohSettings) -> str:
    """Return the cloud's sentence about a robot with the right certificate that sends nothing to this cloud."""
    return (
        f"A robot with the certificate of {settings.peer_name} is connected and says nothing under uid {settings.uid}: "
        "its bundle is of an earlier RobotOffload of that name; write the bundle again"
    )


def second_session(settings: ZenohSettings, sessions: int) -> str:
    """Return the cloud's sentence about two robots with one certificate."""
    return (
        f"{sessions} {settings.session} sessions show the certificate of {settings.peer_name}: a second agent, or a "
        "copy of the robot's key; end the second agent, or revoke the certificate"
    )


def stranger(settings: ZenohSettings, names: Iterable[str]) -> str:
    """Return the cloud's sentence about clients with another name in their certificate."""
    shown = ", ".join(sorted(name or "none" for name in names))
    return f"Clients with the certificate of {shown} are connected; only {settings.peer_name} is served here"


def udp_blocked(settings: ZenohSettings, where: str) -> str:
    """Return the robot's sentence about a fallback in use."""
    primary = ", ".join(settings.endpoints)
    return (
        f"UDP to {primary} gets no answer, {where} does: open the UDP port on the way; over TCP a loss is noticed later"
    )
