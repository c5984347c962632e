"""The consumer behind the collector: takes what `burst` publishes, and reports how long each message was on its way.

Standard input takes `{"stage": N}`; standard output answers with the latencies of that stage in milliseconds,
`{"stage": N, "collected": [...], "direct": [...]}`, and once with `{"ready": true}`.
"""

from __future__ import annotations

import json
import sys
from collections import defaultdict
from functools import partial
from typing import Any

import rclpy
from std_msgs.msg import UInt8MultiArray

from robot_offload_lab.bench.parts import node
from robot_offload_lab.bench.parts.burst import DEPTH, DIRECT, HEAD, MARK, OUTPUT, say


class Sink:
    """Two subscriptions that only look at the mark."""

    def __init__(self) -> None:
        self.node = rclpy.create_node("sink")
        self._took_ms: dict[tuple[int, str], list[float]] = defaultdict(list)
        for topic, name in ((OUTPUT, "collected"), (DIRECT, "direct")):
            self.node.create_subscription(UInt8MultiArray, topic, partial(self._take, name), DEPTH, raw=True)

    def _take(self, name: str, data: bytes, info: Any) -> None:
        sent_s, stage, _ = MARK.unpack_from(data, HEAD.size)
        self._took_ms[stage, name].append(round((info["received_timestamp"] / 1e9 - sent_s) * 1e3, 4))

    def stage(self, number: int) -> dict[str, Any]:
        """Returns what came of a stage."""
        return {"stage": number, **{name: self._took_ms[number, name] for name in ("collected", "direct")}}


def main() -> None:
    """Answers until standard input ends."""
    node.start()
    sink = Sink()
    node.spin_in_background(sink.node)
    say({"ready": True})
    for line in sys.stdin:
        say(sink.stage(json.loads(line)["stage"]))
    rclpy.shutdown()


if __name__ == "__main__":
    main()
