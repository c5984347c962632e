#!/usr/bin/env python3
"""A participant that comes new, asks for what `answering` offers under a place, and tells in JSON what it got.

    asking.py PLACE [--patience SECONDS] [--only topic,service,action]

It ends when it has got everything, or when its patience is over.
"""

import argparse
import json
import sys
import time
from collections.abc import Callable
from typing import Any

import rclpy
from rclpy.action import ActionClient
from rclpy.node import Node
from std_msgs.msg import String
from std_srvs.srv import Trigger
from test_msgs.action import Fibonacci

ORDER = 8
AGAIN_S = 2.0
"""A call that got no answer by then is given up and made again: the first one may be lost while both sides meet."""


class Asking:
    """What was got, by kind; asks for the rest."""

    def __init__(self, node: Node, place: str) -> None:
        self.got: dict[str, dict[str, Any]] = {}
        self._begun_s = time.monotonic()
        self._asked_s = {"service": 0.0, "action": 0.0}
        self._service = node.create_client(Trigger, f"/{place}/answer")
        self._action = ActionClient(node, Fibonacci, f"/{place}/count")
        node.create_subscription(String, f"/{place}/told", lambda message: self._take("topic", message.data), 10)

    def ask(self) -> None:
        """Calls what is there and has not answered."""
        if self._due("service", self._service.service_is_ready):
            self._service.call_async(Trigger.Request()).add_done_callback(
                lambda future: self._take("service", future.result().message)
            )
        if self._due("action", self._action.server_is_ready):
            self._action.send_goal_async(Fibonacci.Goal(order=ORDER)).add_done_callback(self._accepted)

    def _due(self, kind: str, ready: Callable[[], bool]) -> bool:
        now_s = time.monotonic()
        if kind in self.got or now_s - self._asked_s[kind] < AGAIN_S or not ready():
            return False
        self._asked_s[kind] = now_s
        return True

    def _accepted(self, future: Any) -> None:  # rclpy does not type its futures
        future.result().get_result_async().add_done_callback(
            lambda done: self._take("action", list(done.result().result.sequence))
        )

    def _take(self, kind: str, answer: object) -> None:
        after_s = time.monotonic() - self._begun_s
        self.got.setdefault(kind, {"answer": answer, "after_s": round(after_s, 3)})


def main() -> None:
    """Asks until there is nothing left to ask for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("place")
    parser.add_argument("--patience", type=float, default=60.0)
    parser.add_argument("--only", default="topic,service,action")
    chosen = parser.parse_args()
    wanted = set(chosen.only.split(","))
    rclpy.init(args=[])
    node = rclpy.create_node("asking")
    asking = Asking(node, chosen.place)
    end_s = time.monotonic() + chosen.patience
    while not wanted <= asking.got.keys() and time.monotonic() < end_s:
        rclpy.spin_once(node, timeout_sec=0.1)
        asking.ask()
    sys.stdout.write(json.dumps(asking.got) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
