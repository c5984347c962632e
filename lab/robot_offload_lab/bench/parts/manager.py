"""A manager of lifecycle nodes, as a user would write one: activates and deactivates, and times every answer.

Standard input takes `{"nodes": [...], "rounds": N, "rest_ms": [LOW, HIGH]}`; standard output answers with
`{"activate": [[ms of each node], ...], "deactivate": [...], "refused": N, "unanswered": N}`, a list for each round. All
nodes of a round are asked at once. `{"find": [...]}` answers as soon as all these nodes can be asked.
"""

from __future__ import annotations

import json
import random
import sys
import time
from typing import Any, Final

import rclpy
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.executors import SingleThreadedExecutor

from robot_offload_lab.wire.loop import steady_s

PATIENCE_S: Final = 30.0
TRANSITIONS: Final = {
    "activate": Transition.TRANSITION_ACTIVATE,
    "deactivate": Transition.TRANSITION_DEACTIVATE,
}


class Manager:
    """Clients of the nodes' services and an executor."""

    def __init__(self) -> None:
        self._node = rclpy.create_node("bench_manager")
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._clients: dict[str, Any] = {}

    def find(self, names: list[str]) -> None:
        """Wait until every node can be asked.

        Raises:
            SystemExit: one cannot be found.
        """
        for name in names:
            client = self._clients.setdefault(name, self._node.create_client(ChangeState, f"/{name}/change_state"))
            if not client.wait_for_service(PATIENCE_S):
                raise SystemExit(f"{name}: no lifecycle service was found within {PATIENCE_S:g} s")

    def change(self, names: list[str], transition: int) -> tuple[list[float], int, int]:
        """Ask all at once; return the milliseconds until each answer, how many refused, and how many said nothing."""
        request = ChangeState.Request(transition=Transition(id=transition))
        took_ms: dict[str, float] = {}
        refused: set[str] = set()
        start_s = steady_s()

        def answered(name: str, future: Any) -> None:
            took_ms[name] = (steady_s() - start_s) * 1e3
            if not future.result().success:
                refused.add(name)

        for name in names:
            future = self._clients[name].call_async(request)
            future.add_done_callback(lambda done, name=name: answered(name, done))
        while len(took_ms) < len(names) and steady_s() - start_s < PATIENCE_S:
            self._executor.spin_once(timeout_sec=0.1)
        return list(took_ms.values()), len(refused), len(names) - len(took_ms)

    def rounds(self, order: dict[str, Any]) -> dict[str, Any]:
        """Activate and deactivates the nodes again and again."""
        found: dict[str, Any] = {"activate": [], "deactivate": [], "refused": 0, "unanswered": 0}
        low_ms, high_ms = order["rest_ms"]
        for _ in range(order["rounds"]):
            for word, transition in TRANSITIONS.items():
                time.sleep(random.uniform(low_ms, high_ms) / 1e3)
                took_ms, refused, unanswered = self.change(order["nodes"], transition)
                found[word].append([round(value, 4) for value in took_ms])
                found["refused"] += refused
                found["unanswered"] += unanswered
        return found


def main() -> None:
    """Obey until standard input ends."""
    rclpy.init(args=[], signal_handler_options=rclpy.SignalHandlerOptions.NO)
    manager = Manager()
    for line in sys.stdin:
        order = json.loads(line)
        if "find" in order:
            manager.find(order["find"])
            answer: dict[str, Any] = {"found": order["find"]}
        else:
            answer = manager.rounds(order)
        sys.stdout.write(json.dumps(answer) + "\n")
        sys.stdout.flush()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
