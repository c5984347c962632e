"""The state of the robot's control process as numbers and single words, for viewers that plot them.

The same topics exist live and in recordings, so that one layout serves both. Round trips are published only while
there is a subscriber; the others at changes.
"""

from __future__ import annotations

import math
from typing import Final

from rcl_interfaces.msg import Log
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Float64, Int32, String

from robot_offload_core.fence.token import Site
from robot_offload_core.link.links import Link

ACTING: Final = "/offload/acting"
PASSING: Final = "/offload/passing"
REASON: Final = "/offload/reason"
NOTES: Final = "/offload/notes"
ROUND_TRIP: Final = "/offload/round_trip_ms"
NUMBERS: Final = {Site.ROBOT: 0, Site.CLOUD: 1}
NOBODY: Final = -1
SHOWN_S: Final = 0.1
"""How often a round trip is published."""
LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
SAMPLES = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)


class Live:
    """Publishers of a node, used on the deciding thread."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._acting = node.create_publisher(Int32, ACTING, LATCHED)
        self._passing = node.create_publisher(Int32, PASSING, LATCHED)
        self._reason = node.create_publisher(String, REASON, LATCHED)
        self._notes = node.create_publisher(Log, NOTES, LATCHED)
        self._round_trip = node.create_publisher(Float64, ROUND_TRIP, SAMPLES)
        self._said: tuple[Site, str] | None = None
        self._gate: int | None = None
        self._echo_sent_s = -math.inf

    def decided(self, site: Site, reason: str) -> None:
        """Publish the active side (0: the robot, 1: the cloud) and the reason word, when that has changed."""
        if (site, reason) == self._said:
            return
        self._said = site, reason
        self._acting.publish(Int32(data=NUMBERS[site]))
        self._reason.publish(String(data=reason))

    def passes(self, site: Site | None) -> None:
        """Publish whose messages pass at the collector (0: the robot's, 1: the cloud's, -1: unknown), at changes."""
        number = NOBODY if site is None else NUMBERS[site]
        if number != self._gate:
            self._gate = number
            self._passing.publish(Int32(data=number))

    def note(self, message: str) -> None:
        """Publish a decision as a sentence, like a line of a log."""
        line = Log(level=Log.INFO, name=self._node.get_name(), msg=message)
        line.stamp = self._node.get_clock().now().to_msg()
        self._notes.publish(line)

    def measured(self, link: Link) -> None:
        """Publish the round trip of the newest echo, at most ten a second, while there is a subscriber."""
        sent_s = link.echo_sent_s
        if sent_s is None or sent_s - self._echo_sent_s < SHOWN_S or link.round_trip_s is None:
            return
        self._echo_sent_s = sent_s
        if self._round_trip.get_subscription_count():
            self._round_trip.publish(Float64(data=link.round_trip_s * 1e3))
