"""Ports for tests."""

from __future__ import annotations

import random
import socket

HOST = "127.0.0.1"
PORTS = range(18_000, 25_000)
"""Below those that Linux gives to whoever dials out, and below those of these tests' ROS domains (71 and more)."""
given: set[int] = set()
"""A port is given once: some time passes until it is bound."""


def free_port() -> int:
    """A port of the loopback interface that is free for UDP and for TCP, and that no other socket gets by chance."""
    while True:
        port = random.choice(PORTS)
        if port not in given and free_for_tcp(port) and free_for_udp(port):
            given.add(port)
            return port


def free_for_tcp(port: int) -> bool:
    """Returns whether nobody listens at a port of any interface for TCP now."""
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as tcp:
        try:
            tcp.bind(("", port))
        except OSError:
            return False
    return True


def free_for_udp(port: int) -> bool:
    """Returns whether nobody has a port of any interface for UDP now."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp:
        try:
            udp.bind(("", port))
        except OSError:
            return False
    return True
