"""Stock clients of actions and services, and what they hear of one goal."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.action import ActionClient
from rclpy.node import Node
from test_msgs.action import Fibonacci

from robot_offload_agent.runtime.clock import now_s
from tests.ros.agent.ears import wait_until

PATIENCE_S = 60.0
SUCCEEDED, CANCELED, ABORTED = 4, 5, 6


class Goal:
    """One goal of a stock ActionClient.

    Attributes:
        feedback: (arrival, process, tick).
        codes: of the answers to cancels.
        results: statuses, each with the process that finished it: exactly one at the end.
    """

    def __init__(self, client: ActionClient, order: int) -> None:
        self.feedback: list[tuple[float, int, int]] = []
        self.results: list[tuple[int, int]] = []
        self.handle: Any = None
        self.codes: list[int] = []
        self.client, self.order = client, order
        self._do(self._send)

    def _do(self, act: Callable[[], None]) -> None:
        """Acts on the thread that spins: in rclpy 7 an answer may be taken before its request is noted (rclpy#1123)."""
        self.client._node.executor.create_task(act)

    def _send(self) -> None:
        goal = Fibonacci.Goal(order=self.order)
        self.client.send_goal_async(goal, feedback_callback=self._heard).add_done_callback(self._sent)

    def cancel(self) -> int:
        """Returns the code of the answer to a cancel."""
        self._do(self._cancel)
        until(lambda: bool(self.codes), "the answer to a cancel")
        return self.codes[0]

    def _cancel(self) -> None:
        answered = self.handle.cancel_goal_async()
        answered.add_done_callback(lambda future: self.codes.append(future.result().return_code))

    def _heard(self, message: Any) -> None:
        self.feedback.append((now_s(), *message.feedback.sequence))

    def _sent(self, future: Any) -> None:
        self.handle = future.result()
        if self.handle.accepted:
            self.handle.get_result_async().add_done_callback(self._ended)

    def _ended(self, future: Any) -> None:
        answer = future.result()
        self.results.append((answer.status, next(iter(answer.result.sequence), 0)))

    def accepted(self) -> Goal:
        until(lambda: self.handle is not None, "an answer to a goal")
        assert self.handle.accepted
        return self

    def result(self) -> tuple[int, int]:
        until(lambda: bool(self.results), "the result of a goal")
        return self.results[0]

    def beats(self, count: int = 5) -> None:
        """Waits for more feedback."""
        start = len(self.feedback)
        until(lambda: len(self.feedback) >= start + count, "feedback of a goal")

    def executors(self) -> list[int]:
        """Returns the processes whose feedback was heard, one for each turn of theirs; a turn's ticks only grow."""
        turns: list[int] = []
        last = 0
        for _, process, tick in self.feedback:
            if not turns or turns[-1] != process:
                turns.append(process)
            else:
                assert tick > last, f"feedback went back from {last} to {tick}"
            last = tick
        return turns


def until(condition: Callable[[], Any], what: str, patience_s: float = PATIENCE_S) -> None:
    assert wait_until(condition, patience_s), f"not seen: {what}"


def action_client(node: Node, name: str) -> ActionClient:
    client = ActionClient(node, Fibonacci, name)
    until(client.server_is_ready, f"a server of {name}")
    return client
