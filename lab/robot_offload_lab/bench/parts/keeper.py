"""The bench's replica with state: snapshots of a given size, each with the moment at which it was made.

Parameters: `state_bytes`, `state_hz`. What it goes on from goes to NAME.jsonl of the working folder, NAME being the
node's: when it woke, the snapshots it was given, its first message afterwards.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Final

from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn

from robot_offload_lab.bench.observed import LINES, FirstOutput, Observation, SnapshotTaken, Woken
from robot_offload_lab.bench.parts import node
from robot_offload_lab.bench.parts.replica import Replica
from robot_offload_lab.wire.loop import steady_s
from robot_offload_state import StatefulNode

MADE: Final = struct.Struct("<d")
VERSION: Final = 1


class Keeper(Replica, StatefulNode):
    """A replica that publishes snapshots and records what it goes on from."""

    def __init__(self) -> None:
        super().__init__()
        self.declare_parameter("state_bytes", 1024)
        self.declare_parameter("state_hz", 10.0)
        # Closed by the end of the process; line-buffered, so that nothing is lost with it.
        self._file = Path(f"{self.get_name()}.jsonl").open("w", encoding="utf-8", buffering=1)  # noqa: SIM115
        self._begins = False

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Make the snapshots' filling and their timer."""
        self._filling = bytes(self.get_parameter("state_bytes").value - MADE.size)
        self._keeping = self.create_timer(1.0 / self.get_parameter("state_hz").value, self._keep)
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Take the newest snapshot."""
        self._take_down(Woken(steady_s()))
        self._begins = True
        return super().on_activate(state)

    def take_state(self, version: int, data: bytes) -> None:
        """Take down how old a snapshot is."""
        (made_s,) = MADE.unpack_from(data)
        self._take_down(SnapshotTaken(steady_s(), made_s, len(data)))

    def _keep(self) -> None:
        self.publish_state(VERSION, MADE.pack(steady_s()) + self._filling)

    def _tick(self) -> None:
        super()._tick()
        if self._begins and self._output.is_activated:
            self._begins = False
            self._take_down(FirstOutput(steady_s()))

    def _take_down(self, observation: Observation) -> None:
        self._file.write(LINES.encode(observation) + "\n")


if __name__ == "__main__":
    node.start()
    node.spin(Keeper())
