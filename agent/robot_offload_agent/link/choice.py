"""Chooses the link that the configuration names: `zenoh` or `ros`, and starts what must run beside it."""

from __future__ import annotations

import threading
from collections.abc import Sequence

import rclpy
from rclpy.node import Node

from robot_offload_agent.errors import ConfigurationError
from robot_offload_agent.link.certificate_files import certificate_problem
from robot_offload_agent.link.port import Channel, Link, LinkStatus, OnMessage, OnRoom, no_room
from robot_offload_agent.link.ros import RosLink
from robot_offload_agent.link.zenoh import ZenohLink
from robot_offload_agent.link.zenoh_configured import SESSION_LEASE_MS, zenoh_settings
from robot_offload_agent.link.zenoh_log import WheelLog
from robot_offload_agent.ros import context
from robot_offload_agent.ros.topic_loop import spin_topics
from robot_offload_agent.settings.parameters import Configuration

LINK_NODE_IDLE_S = 60.0
"""A node that carries nothing but a link has no other work to do."""


class LinkHandle:
    """A link with whatever must run beside it (a spinning node for DDS if the process has none)."""

    def __init__(self, link: Link, node: Node | None = None) -> None:
        self.link = link
        self.node = node

    def start(self) -> None:
        """See Link.start."""
        self.link.start()
        if self.node is not None:
            threading.Thread(
                target=spin_topics, args=(self.node, lambda: LINK_NODE_IDLE_S), name="link", daemon=True
            ).start()

    def ended(self) -> bool:
        """Return whether the node that is spun here was ordered to end."""
        return self.node is not None and not rclpy.ok()

    def send(self, channel: str, header: bytes, payload: bytes) -> bool:
        """See Link.send."""
        return self.link.send(channel, header, payload)

    def status(self) -> LinkStatus:
        """See Link.status."""
        return self.link.status()

    def reopen(self, reason: str) -> None:
        """See Link.reopen."""
        self.link.reopen(reason)


def open_link(
    configuration: Configuration,
    session: str,
    channels: Sequence[Channel],
    on_message: OnMessage,
    node: Node | None = None,
    on_room: OnRoom = no_room,
) -> LinkHandle:
    """Make the link of the configured type; `node` is used for DDS if given, else one is made and spun here.

    Raises:
        ConfigurationError: a certificate file is missing.
    """
    if configuration["link.type"] == "zenoh":
        settings = zenoh_settings(configuration, session)
        return LinkHandle(ZenohLink(settings, channels, on_message, WheelLog(), on_room))
    own = None
    if node is None:
        context.init(configuration)
        own = node = context.make_node(configuration, f"offload_{session}_{configuration['side']}")
    return LinkHandle(RosLink(node, configuration["side"], channels, on_message), own)


def check_link(configuration: Configuration) -> None:
    """Check what can be checked before anything is opened; raise ConfigurationError."""
    if configuration["link.type"] == "zenoh":
        for session in SESSION_LEASE_MS:
            problem = certificate_problem(zenoh_settings(configuration, session))
            if problem:
                raise ConfigurationError(f"parameter link.{problem}")
