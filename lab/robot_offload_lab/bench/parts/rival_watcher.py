"""The robot's end of the rivals: prints when each says that the cloud is lost, and when it is back.

`{"t_s": TIME, "rival": NAME, "lost": true | false}`, a line each. Silence is waited for on threads of their own, up to
the deadline, not by polling; the middleware reports the liveliness by an event.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
import threading
from functools import partial
from typing import Any

import rclpy
from rclpy.event_handler import SubscriptionEventCallbacks
from std_msgs.msg import Header

from robot_offload_lab.bench.parts import node
from robot_offload_lab.bench.parts.rival_sender import quality
from robot_offload_lab.bench.rivals import LIVELINESS, RIVALS, Rival, RivalReport
from robot_offload_lab.wire.loop import steady_s

_saying = threading.Lock()


def say(rival: Rival, *, lost: bool) -> None:
    """Print one line."""
    line = json.dumps(dataclasses.asdict(RivalReport(steady_s(), rival.name, lost)))
    with _saying:
        sys.stdout.write(line + "\n")
        sys.stdout.flush()


class Waiting:
    """Lost after a silence, or by a message over the limit; back by the next good one."""

    def __init__(self, rival: Rival, patience_s: float, limit_s: float) -> None:
        self._rival = rival
        self._patience_s = patience_s
        self._limit_s = limit_s
        self._changed = threading.Condition()
        self._deadline_s: float | None = None
        self._lost = True
        threading.Thread(target=self._expire, name=rival.name, daemon=True).start()

    def heard(self, latency_s: float) -> None:
        """Take a message that has come."""
        with self._changed:
            self._deadline_s = steady_s() + self._patience_s
            self._become(lost=latency_s > self._limit_s)
            self._changed.notify()

    def _become(self, *, lost: bool) -> None:
        if lost != self._lost:
            self._lost = lost
            say(self._rival, lost=lost)

    def _expire(self) -> None:
        with self._changed:
            while True:
                left_s = None if self._deadline_s is None else self._deadline_s - steady_s()
                if left_s is not None and left_s <= 0:
                    self._become(lost=True)
                    self._deadline_s = left_s = None
                self._changed.wait(left_s)


class Watcher:
    """A subscription for each rival."""

    def __init__(self, patience_s: float, limit_s: float) -> None:
        self.node = rclpy.create_node("rival_watcher")
        for rival in RIVALS:
            if rival is LIVELINESS:
                events = SubscriptionEventCallbacks(liveliness=partial(self._on_liveliness, rival))
                self.node.create_subscription(Header, rival.name, _ignore, quality(rival), event_callbacks=events)
                continue
            own_limit_s = float("inf") if rival.patience_s else limit_s
            waiting = Waiting(rival, rival.patience_s or patience_s, own_limit_s)
            self.node.create_subscription(Header, rival.name, partial(self._on_message, waiting), quality(rival))

    def _on_message(self, waiting: Waiting, message: Header) -> None:
        now = self.node.get_clock().now().nanoseconds / 1e9
        waiting.heard(now - message.stamp.sec - message.stamp.nanosec / 1e9)

    @staticmethod
    def _on_liveliness(rival: Rival, event: Any) -> None:
        say(rival, lost=not event.alive_count)


def _ignore(_message: Header) -> None:
    """Ignore the message: the middleware's event is what counts."""


def main() -> None:
    """Watch until SIGTERM."""
    parser = argparse.ArgumentParser(prog="python -m robot_offload_lab.bench.parts.rival_watcher", description=__doc__)
    parser.add_argument("--patience", type=float, required=True, help="of silence, seconds")
    parser.add_argument("--limit", type=float, required=True, help="of one message's latency, seconds")
    options = parser.parse_args()
    node.start()
    node.spin(Watcher(options.patience, options.limit).node)


if __name__ == "__main__":
    main()
