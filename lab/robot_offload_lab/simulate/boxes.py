"""Black boxes in virtual time: what they keep must lead the same core to the same decisions, bit for bit."""

from __future__ import annotations

from typing import Any

from robot_offload_core import blackbox
from robot_offload_core.blackbox import Differs, Gap, Replayed
from robot_offload_core.events import Machine
from robot_offload_core.process.control import ControlProcess
from robot_offload_lab.simulate.violations import ViolationError

FRAME_S = 5.0


class MemoryBox:
    """A box whose lines stay in memory; see `events.Witness`."""

    def __init__(self, process: str) -> None:
        self.lines = [blackbox.header({"process": process})]
        self._framed_s: dict[Machine, float] = {}

    def stepped(self, machine: Machine, now_s: float, event: Any, after: Any, commands: Any) -> None:
        """Writes a step, and a state now and then."""
        self.lines.append(blackbox.step(machine, now_s, event, commands))
        if now_s - self._framed_s[machine] >= FRAME_S:
            self._frame(machine, now_s, after)

    def restated(self, machine: Machine, now_s: float, state: Any) -> None:
        """Writes a state that no step has led to."""
        self._frame(machine, now_s, state, was_set=True)

    def _frame(self, machine: Machine, now_s: float, state: Any, *, was_set: bool = False) -> None:
        self._framed_s[machine] = now_s
        self.lines.append(blackbox.key_frame(machine, now_s, state, was_set=was_set))

    def text(self) -> list[str]:
        """Returns the lines, one by one."""
        return "".join(self.lines).splitlines()


class Boxes:
    """A box for each control process that starts."""

    def __init__(self) -> None:
        self.boxes: list[MemoryBox] = []

    def watch(self, process: ControlProcess) -> None:
        """Gives a process a box."""
        self.boxes.append(MemoryBox(process.incarnation))
        process.watched_by(self.boxes[-1])

    def judge(self, now_s: float) -> int:
        """Replays all boxes; returns how many steps that were.

        Raises:
            ViolationError: a replay does not come to what was decided.
        """
        steps = 0
        for box in self.boxes:
            for found in blackbox.replay(box.text()):
                if isinstance(found, Differs | Gap):
                    raise ViolationError("12", f"a black box leads to other decisions: {found!r:.400}", now_s)
                steps += isinstance(found, Replayed)
        return steps
