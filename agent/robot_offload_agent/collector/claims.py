"""One collector per public topic of a ROS domain on this host, whatever the identity of its agent."""

from __future__ import annotations

import hashlib
import socket
from collections.abc import Iterable

from robot_offload_agent.errors import StartError
from robot_offload_agent.runtime import identity


def claim(domain: int, topics: Iterable[str]) -> list[socket.socket]:
    """Take the name of each public topic that only one collector may be in front of; keep the result for life.

    A collector that this host cannot see, in another container or on another computer, is found in the graph
    (`rivals`).

    Raises:
        StartError: another collector has a topic, or the system forbids such names.
    """
    return [_claim(domain, topic) for topic in topics]


def _claim(domain: int, topic: str) -> socket.socket:
    name = f"topic/{domain}/{hashlib.sha256(topic.encode()).hexdigest()[:32]}"  # names are limited to 107 bytes
    try:
        taken = identity.take(name)
    except OSError as error:
        message = f"the name of {topic} cannot be taken on this host ({error}): allow abstract unix sockets"
        raise StartError(message) from error
    if isinstance(taken, socket.socket):
        return taken
    who = f"process {taken.pid}" if taken.pid else "a process in a container, or of another user"
    raise StartError(
        f"{topic} in domain {domain} has another collector on this host already ({who}): consumers would hear both; "
        "stop that agent, or give one of the two another output topic or domain"
    )
