"""Sends every message of the ten types back as it came, bytes for bytes: a lifecycle node that knows nothing of agents.

Parameter `by_itself`: it makes itself Active at the start, because it has no manager.
"""

from __future__ import annotations

from functools import partial
from typing import Any

from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from robot_offload_lab.bench.kinds import KINDS
from robot_offload_lab.bench.parts import node
from robot_offload_lab.bench.parts.kinds_source import message_class


class Echo(LifecycleNode):  # type: ignore[misc]  # rclpy carries no types
    """Ten subscriptions, ten publishers."""

    def __init__(self) -> None:
        super().__init__("echo")
        self.declare_parameter("by_itself", False)
        if self.get_parameter("by_itself").value:
            self.trigger_configure()
            self.trigger_activate()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Create both ends of every topic."""
        for kind in KINDS:
            message = message_class(kind.type)
            output = self.create_lifecycle_publisher(message, kind.returned, 10)
            self.create_subscription(message, kind.sent, partial(self._back, output), 10, raw=True)
        return super().on_configure(state)

    def _back(self, output: Any, data: bytes) -> None:
        if output.is_activated:
            output.publish(data)


if __name__ == "__main__":
    node.start()
    node.spin(Echo())
