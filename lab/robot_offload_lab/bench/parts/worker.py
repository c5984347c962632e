"""Lifecycle nodes of a user, whose transitions are timed: light ones, or with work in their callbacks.

`python -m robot_offload_lab.bench.parts.worker NAME... [--rate HZ] [--work MS] [--active]`: every name is a node of
this process. While a node is Active it publishes a stamped message at the rate. `--work` is the processor time that its
callbacks `on_activate` and `on_deactivate` burn, as those of a localisation node do. Ends with its standard input.
"""

from __future__ import annotations

import argparse
import time

import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from robot_offload_lab.bench.parts import node


class Worker(LifecycleNode):  # type: ignore[misc]  # rclpy carries no types
    """A managed node."""

    def __init__(self, name: str, rate_hz: float, work_s: float) -> None:
        super().__init__(name)
        self._rate_hz = rate_hz
        self._work_s = work_s

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Create output and timer."""
        self._output = self.create_lifecycle_publisher(PoseStamped, f"/bench/{self.get_name()}", 10)
        self._message = PoseStamped()
        self._timer = self.create_timer(1.0 / self._rate_hz, self._tick)
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Work, then publish."""
        burn(self._work_s)
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Work, then falls silent."""
        burn(self._work_s)
        return super().on_deactivate(state)

    def _tick(self) -> None:
        if self._output.is_activated:
            self._message.header.stamp = self.get_clock().now().to_msg()
            self._output.publish(self._message)


def burn(seconds: float) -> None:
    """Use so much processor time."""
    end_s = time.thread_time() + seconds
    while time.thread_time() < end_s:
        pass


def main() -> None:
    """Serve until standard input ends."""
    parser = argparse.ArgumentParser(prog="python -m robot_offload_lab.bench.parts.worker", description=__doc__)
    parser.add_argument("names", nargs="+")
    parser.add_argument("--rate", type=float, default=10.0, help="of the output, Hz")
    parser.add_argument("--work", type=float, default=0.0, help="in each transition, ms of processor time")
    parser.add_argument("--active", action="store_true", help="configured and activated from the start")
    options = parser.parse_args()
    rclpy.init(args=[], signal_handler_options=rclpy.SignalHandlerOptions.NO)
    workers = [Worker(name, options.rate, options.work / 1e3) for name in options.names]
    for worker in workers:
        worker.trigger_configure()
        if options.active:
            worker.trigger_activate()
    node.serve(workers)


if __name__ == "__main__":
    main()
