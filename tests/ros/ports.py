"""Ports for tests."""

from __future__ import annotations

import random
import socket

HOST = "127.0.0.1"
PORTS = range(18_000, 25_000)
"""Below those that Linux gives to whoever dials out, and below those of these tests' ROS domains (71 and more)."""
KINDS = (socket.SOCK_STREAM, socket.SOCK_DGRAM)
given: set[int] = set()
"""A port is given once: some time passes until it is bound."""


def free_port() -> int:
    """A port of the loopback interface that is free for UDP and for TCP, and that no other socket gets by chance."""
    while True:
        port = random.choice(PORTS)
        if port not in given and all(is_free(port, kind) for kind in KINDS):
            given.add(port)
            return port


def is_free(port: int, kind: socket.SocketKind) -> bool:
    """Returns whether nobody has a port of any interface for UDP, or listens at it for TCP, now."""
    with socket.socket(socket.AF_INET, kind) as tried:
        try:
            tried.bind(("", port))
        except OSError:
            return False
    return True
