"""Black boxes in virtual time: their content must lead the same core to the same decisions, bit for bit."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from robot_offload_core.control.process import ControlProcess
from robot_offload_core.record import blackbox
from robot_offload_core.record.blackbox import Differs, Gap, Replayed
from robot_offload_core.words.events import Machine
from robot_offload_sim.world.violations import ViolationError

FRAME_S = 5.0
WHOLE = (0.0, math.inf)


class MemoryBox:
    """A box whose lines stay in memory; see `events.Witness`.

    Args:
        process: the process that writes.
        clock_s: true time.
        window_s: start and end (true time) of the steps that the box keeps; the state after the last step of a machine
            is written too.
    """

    def __init__(self, process: str, clock_s: Callable[[], float], window_s: tuple[float, float] = WHOLE) -> None:
        self.lines = [blackbox.header({"process": process})]
        self.clock_s, self.window_s = clock_s, window_s
        self._framed_s: dict[Machine, float] = {}
        self._closed: set[Machine] = set()

    def stepped(self, machine: Machine, now_s: float, event: Any, after: Any, commands: Any) -> None:
        """Write a step, and occasionally a state."""
        if self.clock_s() < self.window_s[0] or machine in self._closed:
            return
        if machine not in self._framed_s:
            self._frame(machine, now_s, after)
            return
        self.lines.append(blackbox.step(machine, now_s, event, commands))
        closes = self.clock_s() > self.window_s[1]
        if closes or now_s - self._framed_s[machine] >= FRAME_S:
            self._frame(machine, now_s, after)
        if closes:
            self._closed.add(machine)

    def restated(self, machine: Machine, now_s: float, state: Any) -> None:
        """Write a state that did not follow from a step."""
        if self.window_s[0] <= self.clock_s() and machine not in self._closed:
            self._frame(machine, now_s, state, was_set=True)

    def broke(self, machine: Machine, now_s: float, event: Any, rule: str) -> None:
        """Write a step that broke a rule."""
        if machine in self._framed_s and machine not in self._closed:
            self.lines.append(blackbox.broken_step(machine, now_s, event, rule))

    def _frame(self, machine: Machine, now_s: float, state: Any, *, was_set: bool = False) -> None:
        self._framed_s[machine] = now_s
        self.lines.append(blackbox.key_frame(machine, now_s, state, was_set=was_set))

    def text(self) -> list[str]:
        """Return the lines, one by one."""
        return "".join(self.lines).splitlines()


class Boxes:
    """A box for each control process that starts; arguments as of `MemoryBox`."""

    def __init__(self, clock_s: Callable[[], float], window_s: tuple[float, float] = WHOLE) -> None:
        self.boxes: list[MemoryBox] = []
        self.clock_s, self.window_s = clock_s, window_s

    def watch(self, process: ControlProcess) -> None:
        """Give a process a box."""
        self.boxes.append(MemoryBox(process.incarnation, self.clock_s, self.window_s))
        process.watched_by(self.boxes[-1])

    def judge(self, now_s: float) -> int:
        """Replay all boxes; return the number of steps.

        Raises:
            ViolationError: a replay does not give the recorded decisions.
        """
        steps = 0
        for box in self.boxes:
            for found in blackbox.replay(box.text()):
                if isinstance(found, Differs | Gap):
                    raise ViolationError("12", f"a black box leads to other decisions: {found!r:.400}", now_s)
                steps += isinstance(found, Replayed)
        return steps
