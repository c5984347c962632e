"""A client of actions and services as users write it, with rclpy's own classes and one thread.

`python -m robot_offload_lab.bench.parts.goal_client FILE`. Standard input takes JSON, a line each: `{"goals": COUNT,
"order": N, "prefix": P}` sends goals at once, `{"accept": COUNT, "prefix": P}` one short goal after the other,
`{"calls": COUNT, "prefix": P}` one call after the other. What it hears goes to the file and to standard output.
"""

from __future__ import annotations

import argparse
import json
import os
import select
import sys
from pathlib import Path
from typing import Any, Final

import rclpy
from rclpy.action import ActionClient
from std_srvs.srv import Trigger
from test_msgs.action import Fibonacci

from robot_offload_lab.bench.observed import LINES, CallAnswered, GoalAnswered, GoalEnded, GoalFeedback, Observation
from robot_offload_lab.bench.parts import node
from robot_offload_lab.wire.loop import steady_s

ATTEND_S: Final = 0.002
PREFIXES: Final = ("/bench", "/direct")
SHORT: Final = 1


class Client:
    """Clients of both paths around one file."""

    def __init__(self, path: Path) -> None:
        # Closed by the end of the process; line-buffered, so that nothing is lost with it.
        self._file = path.open("w", encoding="utf-8", buffering=1)
        self._unread = b""
        self.node = rclpy.create_node("bench_goal_client")
        self._actions = {p: ActionClient(self.node, Fibonacci, f"{p}/count") for p in PREFIXES}
        self._services = {p: self.node.create_client(Trigger, f"{p}/ask") for p in PREFIXES}
        self._goals = 0
        self._left = 0

    def attend(self) -> None:
        """Carry out the commands that have come."""
        if not select.select([sys.stdin], [], [], 0)[0]:
            return
        *lines, self._unread = (self._unread + os.read(sys.stdin.fileno(), 4096)).split(b"\n")
        for line in lines:
            self._do(json.loads(line))

    def _do(self, command: dict[str, Any]) -> None:
        prefix = command["prefix"]
        if "goals" in command:
            for _ in range(command["goals"]):
                self._send(prefix, command["order"])
        elif "accept" in command:
            self._left = command["accept"]
            self._next_goal(prefix)
        elif "calls" in command:
            self._left = command["calls"]
            self._next_call(prefix)

    def _next_goal(self, prefix: str) -> None:
        if self._left:
            self._left -= 1
            self._send(prefix, SHORT, one_by_one=True)

    def _send(self, prefix: str, order: int, *, one_by_one: bool = False) -> None:
        self._goals += 1
        number, asked_s = self._goals, steady_s()

        def heard(message: Any) -> None:
            process, tick = message.feedback.sequence
            self._take(GoalFeedback(steady_s(), number, process, tick))

        def ended(future: Any) -> None:
            answer = future.result()
            process = next(iter(answer.result.sequence), 0)
            self._take(GoalEnded(steady_s(), number, prefix, answer.status, process))
            if one_by_one:
                self._next_goal(prefix)

        def answered(future: Any) -> None:
            handle = future.result()
            self._take(GoalAnswered(steady_s(), asked_s, number, prefix, order, handle.accepted))
            if handle.accepted:
                handle.get_result_async().add_done_callback(ended)
            elif one_by_one:
                self._next_goal(prefix)

        sent = self._actions[prefix].send_goal_async(Fibonacci.Goal(order=order), feedback_callback=heard)
        sent.add_done_callback(answered)

    def _next_call(self, prefix: str) -> None:
        if not self._left:
            return
        self._left -= 1
        asked_s = steady_s()

        def answered(future: Any) -> None:
            self._take(CallAnswered(steady_s(), asked_s, prefix, future.result().success))
            self._next_call(prefix)

        self._services[prefix].call_async(Trigger.Request()).add_done_callback(answered)

    def _take(self, observation: Observation) -> None:
        line = LINES.encode(observation) + "\n"
        self._file.write(line)
        if not isinstance(observation, GoalFeedback):
            sys.stdout.write(line)
            sys.stdout.flush()


def main() -> None:
    """Ask until SIGTERM."""
    parser = argparse.ArgumentParser(prog="python -m robot_offload_lab.bench.parts.goal_client", description=__doc__)
    parser.add_argument("file", type=Path, help="what to write")
    options = parser.parse_args()
    node.start()
    client = Client(options.file)
    node.spin(client.node, client.attend, ATTEND_S)


if __name__ == "__main__":
    main()
