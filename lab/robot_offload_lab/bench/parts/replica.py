"""A user's lifecycle node, as light as it can be: the machine is to be busy with the product, not with the node.

While it is Active it publishes stamped messages on `command`. Its timer runs freely from the configuration on, in
every state, so the wait for the first message after an activation is whatever phase the timer has; nothing is
published by the transition itself. An ordinary ROS 2 node that knows nothing of the agents.
"""

from __future__ import annotations

from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from sensor_msgs.msg import CompressedImage

from robot_offload_lab.bench.parts import node


class Replica(LifecycleNode):  # type: ignore[misc]  # rclpy carries no types
    """Parameters: `rate_hz`, `payload_bytes` (a list; the sizes take turns)."""

    def __init__(self) -> None:
        super().__init__("replica")
        self.declare_parameter("rate_hz", 20.0)
        self.declare_parameter("payload_bytes", [64])

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Create the output and the timer."""
        self._stamped = node.Stamped(self.get_name(), self.get_parameter("payload_bytes").value)
        self._output = self.create_lifecycle_publisher(CompressedImage, "/bench/command", 10)
        self._timer = self.create_timer(1.0 / self.get_parameter("rate_hz").value, self._tick)
        return super().on_configure(state)

    def _tick(self) -> None:
        if self._output.is_activated:
            self._output.publish(self._stamped.next(self.get_clock().now().to_msg()))


if __name__ == "__main__":
    node.start()
    node.spin(Replica())
