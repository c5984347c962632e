#!/usr/bin/env python3
"""ROS lifecycle node `ticker`: a stamped message on `tick` while it is Active, and nothing else to do."""

import signal
from types import FrameType

import rclpy
from geometry_msgs.msg import TwistStamped
from rclpy.clock import Clock, ClockType
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.signals import SignalHandlerOptions


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


def main() -> None:
    """Runs the node until SIGINT or SIGTERM."""
    stop = False

    def on_signal(_number: int, _frame: FrameType | None) -> None:
        nonlocal stop
        stop = True

    signal.signal(signal.SIGINT, on_signal)
    signal.signal(signal.SIGTERM, on_signal)
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = Ticker()
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    while not stop:
        executor.spin_once(timeout_sec=0.2)
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
