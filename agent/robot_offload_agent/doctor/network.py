"""Whether the cloud answers from here, over UDP and over TCP."""

from __future__ import annotations

import os
import re
import socket
import ssl
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass

from robot_offload_agent.doctor.findings import Check, Finding, Level
from robot_offload_agent.link.zenoh_configured import zenoh_settings
from robot_offload_agent.settings.parameters import Configuration

PATIENCE_S = 2.0
TRIES = 3
UNKNOWN_VERSION = bytes.fromhex("0a1a2a3a")
"""A QUIC version of the pattern that no server supports; a server answers with its versions (RFC 9000, 6.1 and 15)."""
LEAST_INITIAL = 1200
"""A server drops a shorter first packet (RFC 9000, 14.1)."""
_ENDPOINT = re.compile(r"(quic|tls)/(\[[^\]]+\]|[^/:?#]+):(\d+)")


@dataclass(frozen=True)
class Endpoint:
    """Where the robot dials.

    Attributes:
        scheme: `quic` (UDP) or `tls` (TCP).
        host: name or address.
        port: of the cloud.
    """

    scheme: str
    host: str
    port: int

    def __str__(self) -> str:
        return f"{'UDP' if self.scheme == 'quic' else 'TCP'} {self.host}:{self.port}"


def endpoints(configuration: Configuration) -> Iterator[Endpoint]:
    """Return each endpoint that this robot dials, once."""
    if configuration["link.type"] != "zenoh":
        return
    seen = set()
    for session in ("pulse", "data"):
        settings = zenoh_settings(configuration, session)
        for text in (*settings.endpoints, *settings.fallback):
            found = _ENDPOINT.match(text)
            if found and text not in seen:
                seen.add(text)
                yield Endpoint(found[1], found[2].strip("[]"), int(found[3]))


def judge(reached: list[tuple[Endpoint, str]]) -> Iterator[Finding]:
    """Return whether the cloud can be reached; one of the two ways is enough. Pure.

    Args:
        reached: each endpoint and its problem; empty: it answered.
    """
    for scheme, name, step in (
        (
            "quic",
            Check.CLOUD_UDP,
            "Let UDP to this port out of the robot's network; over TCP lost packets cost latency.",
        ),
        ("tls", Check.CLOUD_TCP, "Let TCP to this port out of the robot's network; it is used where UDP is blocked."),
    ):
        tried = [(endpoint, problem) for endpoint, problem in reached if endpoint.scheme == scheme]
        other = any(not problem for endpoint, problem in reached if endpoint.scheme != scheme)
        for endpoint, problem in tried:
            if problem:
                level = Level.WARNING if other else Level.ERROR
                yield Finding(name, level, f"{endpoint} does not answer: {problem}", step)
        if tried and not any(problem for _, problem in tried):
            yield Finding(name, Level.OK, ", ".join(f"{endpoint} answers" for endpoint, _ in tried))


def reach(endpoint: Endpoint, own: tuple[str, str] | None = None, patience_s: float = PATIENCE_S) -> str:
    """Return why an endpoint does not answer; empty: it does. Open no session.

    Args:
        endpoint: where the robot dials.
        own: files of the robot's certificate and key; without them the cloud logs that it refused a robot.
        patience_s: how long to wait for an answer.
    """
    kind = socket.SOCK_DGRAM if endpoint.scheme == "quic" else socket.SOCK_STREAM
    try:
        family, _, _, _, address = socket.getaddrinfo(endpoint.host, endpoint.port, type=kind)[0]
    except OSError as error:
        return f"{endpoint.host}: {error.strerror or error}"
    try:
        with socket.socket(family, kind) as opened:
            opened.settimeout(patience_s)
            opened.connect(address)
            return _asked(opened, patience_s) if kind == socket.SOCK_DGRAM else _greeted(opened, own)
    except TimeoutError:
        return f"no answer within {patience_s:g} s"
    except OSError as error:
        return error.strerror or str(error)


def _asked(opened: socket.socket, patience_s: float) -> str:
    """Ask a QUIC server for its versions."""
    identity = os.urandom(8)
    head = bytes([0xC0]) + UNKNOWN_VERSION + bytes([8]) + identity + bytes([8]) + os.urandom(8)
    opened.settimeout(patience_s / TRIES)
    for _ in range(TRIES):
        opened.send(head.ljust(LEAST_INITIAL, b"\0"))
        try:
            answer = opened.recv(2048)
        except TimeoutError:
            continue
        return "" if len(answer) > 5 and answer[0] & 0x80 else "something answers that speaks no QUIC"
    return f"no answer within {patience_s:g} s"


def _greeted(opened: socket.socket, own: tuple[str, str] | None) -> str:
    """Greet a TLS server; if it then refuses a client without certificate, that is an answer, too."""
    context = ssl.create_default_context()
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    if own is not None:
        with suppress(OSError):  # named by the check of the certificates
            context.load_cert_chain(*own)
    try:
        with context.wrap_socket(opened):
            return ""
    except ssl.SSLError as error:
        return "" if "ALERT" in str(error).upper() else "something answers that speaks no TLS"
