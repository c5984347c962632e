#!/usr/bin/env python3
"""ROS lifecycle node `ticker`: a stamped message on `tick` while it is Active, and nothing else to do."""

from geometry_msgs.msg import TwistStamped
from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from running import run  # type: ignore[import-not-found]  # of the wheelchair, in the same folder there


class Ticker(LifecycleNode):
    """Parameter: `rate_hz`."""

    def __init__(self) -> None:
        super().__init__("ticker")
        self.declare_parameter("rate_hz", 10.0)
        self._wall = Clock(clock_type=ClockType.SYSTEM_TIME)
        self._sequence = 0

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Creates the output and the timer, which runs from now on in every state."""
        self._output = self.create_lifecycle_publisher(TwistStamped, "tick", 10)
        self._timer = self.create_timer(1.0 / self.get_parameter("rate_hz").value, self._tick)
        return super().on_configure(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Undoes on_configure."""
        self.destroy_timer(self._timer)
        self.destroy_lifecycle_publisher(self._output)
        return super().on_cleanup(state)

    def _tick(self) -> None:
        if not self._output.is_activated:
            return
        self._sequence += 1
        message = TwistStamped()
        message.header.stamp = self._wall.now().to_msg()
        # A consumer can tell duplicates, losses and reordering from it.
        message.header.frame_id = f"{self.get_name()}#{self._sequence}"
        self._output.publish(message)


if __name__ == "__main__":
    run(Ticker)
