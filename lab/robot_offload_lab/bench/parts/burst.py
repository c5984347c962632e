"""A lifecycle node that publishes at the given rate and size, on its collected output and on a direct topic.

Standard input takes `{"stage": N, "bytes": SIZE, "rate_hz": RATE, "seconds": LENGTH}`; standard output answers with
`{"stage": N, "sent": COUNT, "behind_ms": TIME}` at its end, and once with `{"active": true}`. The direct message
follows half a period after the collected one, so that neither waits for the other.
"""

from __future__ import annotations

import json
import struct
import sys
import time
from typing import Any, Final

import rclpy
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from std_msgs.msg import UInt8MultiArray

from robot_offload_lab.bench.parts import node
from robot_offload_lab.wire.loop import steady_s

OUTPUT: Final = "/bench/command"
DIRECT: Final = "/bench/direct"
MARK: Final = struct.Struct("<dII")
"""Time of sending (system clock), stage, number: the first bytes of the data."""
HEAD: Final = struct.Struct("<4sIII")
"""A serialized UInt8MultiArray before its data: encapsulation, no dimensions, offset, length."""
DEPTH: Final = 10


def message(size: int) -> bytearray:
    """Returns a serialized message with so many bytes of data, made once for all of a stage."""
    return bytearray(HEAD.pack(b"\0\1\0\0", 0, 0, size) + bytes(size))


def mark(data: bytearray, stage: int, number: int) -> bytes:
    """Returns the message as it is sent now."""
    MARK.pack_into(data, HEAD.size, time.clock_gettime(time.CLOCK_REALTIME), stage, number)
    return bytes(data)


class Burst(LifecycleNode):  # type: ignore[misc]  # rclpy carries no types
    """The node; its work is done by `run`."""

    def __init__(self) -> None:
        super().__init__("burst")
        self.direct = self.create_publisher(UInt8MultiArray, DIRECT, DEPTH)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Creates the output."""
        self.output = self.create_lifecycle_publisher(UInt8MultiArray, OUTPUT, DEPTH)
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Tells that it may begin."""
        say({"active": True})
        return super().on_activate(state)

    def run(self, stage: dict[str, Any]) -> dict[str, Any]:
        """Publishes one stage; returns what was sent."""
        data, half_s = message(stage["bytes"]), 0.5 / stage["rate_hz"]
        count = round(stage["seconds"] * stage["rate_hz"])
        due_s = steady_s()
        for number in range(count):
            for publisher in (self.output, self.direct):
                publisher.publish(mark(data, stage["stage"], number))
                due_s += half_s
                time.sleep(max(0.0, due_s - steady_s()))
        return {"stage": stage["stage"], "sent": count, "behind_ms": max(0.0, steady_s() - due_s) * 1e3}


def say(words: dict[str, Any]) -> None:
    """Prints one line."""
    sys.stdout.write(json.dumps(words) + "\n")
    sys.stdout.flush()


def main() -> None:
    """Obeys until standard input ends."""
    node.start()
    burst = Burst()
    node.spin_in_background(burst)
    for line in sys.stdin:
        say(burst.run(json.loads(line)))
    rclpy.shutdown()


if __name__ == "__main__":
    main()
