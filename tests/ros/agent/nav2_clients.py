"""Clients of actions that act as Nav2's own do, written from their behaviour, with a ROS context of their own.

Each works on its own thread only while it is asked to, as `rclpy.spin_until_future_complete` and a tree's tick do.
"""

from __future__ import annotations

import time
from typing import Any, Self

import rclpy
from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.task import Future
from test_msgs.action import Fibonacci

EXECUTING = (1, 2)
"""A goal's status while it can be canceled: accepted, executing."""
SERVER_TIMEOUT_S = 0.02
"""`default_server_timeout` of Nav2's behaviour trees: within this a goal is to be acknowledged."""
TICK_S = 0.01
"""`bt_loop_duration`."""
POLL_S = 0.1


class Nav2Client:
    """What both have in common: a node, an action, and every word that came back.

    Attributes:
        feedback: (number of the goal, process, tick).
        asked: for the result of each goal.
    """

    def __init__(self, domain: int, name: str) -> None:
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = rclpy.create_node(name, context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.client = ActionClient(self.node, Fibonacci, "/count")
        self.feedback: list[tuple[int, int, int]] = []
        self.asked: list[Future] = []
        self.handle: Any = None

    def __enter__(self) -> Self:
        assert self.client.wait_for_server(60.0)
        return self

    def __exit__(self, *_: object) -> None:
        self.executor.shutdown()
        self.client.destroy()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)

    def spin(self, future: Future, timeout_s: float | None = None) -> None:
        self.executor.spin_until_future_complete(future, timeout_s)

    def send(self, order: int) -> Future:
        """Sends a goal."""
        goal, number = Fibonacci.Goal(order=order), len(self.asked)
        return self.client.send_goal_async(
            goal, feedback_callback=lambda heard: self.feedback.append((number, *heard.feedback.sequence))
        )

    def took(self, handle: Any) -> None:
        """A goal handle has come: each client asks for its result at once."""
        self.handle = handle
        if handle.accepted:
            self.asked.append(handle.get_result_async())

    @property
    def results(self) -> list[int | None]:
        """Statuses of the goals' results, in the order of the goals; None while there is none."""
        return [asked.result().status if asked.done() else None for asked in self.asked]


class BasicNavigator(Nav2Client):
    """nav2_simple_commander's: waits for answers without a limit, polls the result for ever."""

    def go(self, order: int) -> bool:
        """Sends a goal and returns whether it was accepted; waits for that as long as it takes."""
        sent = self.send(order)
        self.spin(sent)
        self.took(sent.result())
        return bool(self.handle.accepted)

    def is_task_complete(self) -> bool:
        """Spins for 0.1 s and returns whether the result is there."""
        self.spin(self.asked[-1], POLL_S)
        return bool(self.asked[-1].done())

    def cancel_task(self) -> None:
        """Cancels and waits for the answer as long as it takes."""
        self.spin(self.handle.cancel_goal_async())

    def result(self) -> int:
        """Polls until the result is there; returns its status."""
        while not self.is_task_complete():
            pass
        return int(self.asked[-1].result().status)


class TreeNode(Nav2Client):
    """An action node of a behaviour tree, such as FollowPath: ticked, renewed while it runs, halted.

    Attributes:
        acknowledged_s: how long each goal took to be acknowledged.
    """

    def __init__(self, domain: int, name: str) -> None:
        super().__init__(domain, name)
        self.acknowledged_s: list[float] = []

    def renew(self, order: int, patience_s: float) -> None:
        """Sends a goal, the first one or one in the place of another, and waits in ticks until it is acknowledged."""
        sent, began_s = self.send(order), time.monotonic()
        while not sent.done() and time.monotonic() < began_s + patience_s:
            self.spin(sent, TICK_S)
        assert sent.done(), "Timed out while waiting for action server to acknowledge goal request"
        self.acknowledged_s.append(time.monotonic() - began_s)
        self.took(sent.result())
        assert self.handle.accepted, "Goal was rejected by the action server"

    def tick(self, seconds: float) -> None:
        """Ticks for so long; the results of goals that were renewed are of no interest to the tree."""
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s and not self.asked[-1].done():
            self.executor.spin_once(TICK_S)

    def halt(self) -> int:
        """Cancels what runs and waits for both answers; returns the status of the result."""
        if self.handle.status in EXECUTING:
            cancel = self.handle.cancel_goal_async()
            self.spin(cancel)
            assert cancel.result().return_code == 0, "Failed to cancel action server"
        self.spin(self.asked[-1])
        return int(self.asked[-1].result().status)
