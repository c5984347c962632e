"""Writes the black box of a control process to the disk: bounded files, a bounded rate, and without delaying a step.

The deciding thread passes on what it has decided and continues. Another thread turns that into text and writes it four
times a second. When the process ends by itself, what waits is written too, including the step that broke a rule. What
comes faster than the disk or the rate allows is left out and counted, and states are written anew. A disk that is full
or gone ends the box, never the agent.

The files `box-NUMBER.log` are parts of one ring: the oldest is deleted when all together are too large. A restarted
process continues with the next number. Format: `robot_offload_core.record.blackbox`.
"""

from __future__ import annotations

import logging
import threading
from collections import deque
from pathlib import Path
from typing import Any

import robot_offload_core
from robot_offload_agent.runtime import threads
from robot_offload_agent.runtime.clock import wall_us
from robot_offload_agent.runtime.release import release
from robot_offload_agent.settings.override import state_dir
from robot_offload_agent.settings.parameters import Configuration
from robot_offload_core.record import blackbox
from robot_offload_core.words.events import Machine

log = logging.getLogger(__name__)

PARTS = 8
"""Files of the ring: deleting the oldest loses an eighth of the past."""
CLOUD_MIB = 8
"""Limit in the cloud, where a pod's disk is the cluster's."""
TURN_S = 0.25
FRAME_S = 10.0
"""Interval at which the state of each machine is written: a replay begins with one."""
WAITING = 4000
"""Steps that may wait for the writing thread, some twenty seconds of an ordinary robot."""
RATE_BYTES = 262_144
"""Limit of the bytes a second, on the average of a turn; an ordinary robot writes 20 to 30 kB."""

LAST_S = 0.2
"""A process that ends waits at most this long for its last steps to be written."""

Taken = tuple[Machine, float, Any, Any, Any]


class BlackBox:
    """Writer of the black box; a witness (`robot_offload_core.words.events.Witness`).

    Args:
        folder: of the ring, made if it is missing.
        total_bytes: of the ring.
        facts: for the first line of each file.

    Attributes:
        left_out: steps that were not written so far.
        ended: nothing is written any more.
    """

    def __init__(self, folder: Path, total_bytes: int, facts: dict[str, Any]) -> None:
        self.folder, self.part_bytes = folder, total_bytes // PARTS
        self.facts = facts
        self.left_out = 0
        self.ended = False
        self._waiting: deque[Taken | int | str] = deque()
        self._last, self._done = threading.Event(), threading.Event()
        self._missed = 0
        self._framed_s: dict[Machine, float] = {}
        self._number = 0
        self._size = total_bytes  # the first turn begins a file

    def stepped(self, machine: Machine, now_s: float, event: Any, after: Any, commands: Any) -> None:
        """Take a step (deciding thread)."""
        if self.ended:
            return
        if len(self._waiting) >= (WAITING // 2 if self._missed else WAITING):
            self._missed += 1
            return
        if self._missed:
            self._waiting.append(self._missed)
            self._missed = 0
        self._waiting.append((machine, now_s, event, after, commands))

    def restated(self, machine: Machine, now_s: float, state: Any) -> None:
        """Take a state that no step has led to (deciding thread)."""
        self.stepped(machine, now_s, None, state, ())

    def broke(self, machine: Machine, now_s: float, event: Any, rule: str) -> None:
        """Take a step that broke a rule (deciding thread)."""
        if not self.ended:
            self._waiting.append(blackbox.broken_step(machine, now_s, event, rule))

    def finish(self) -> None:
        """Have what waits written, because the process ends; return after `LAST_S` at the latest (any thread)."""
        self._last.set()
        self._done.wait(LAST_S)

    def start(self) -> None:
        """Begin to write, in a thread of its own."""
        threads.start("blackbox", self._run)

    def _run(self) -> None:
        self.facts["core"] = digest_of_core()
        while not self.ended:
            self._last.wait(TURN_S)
            self.turn()
            if self._last.is_set() and not self._waiting:
                break
        self._done.set()

    def turn(self) -> None:
        """Write what has been taken since the last turn."""
        lines: list[str] = []
        budget = int(RATE_BYTES * TURN_S)
        while self._waiting and budget > 0:
            text = self._text(self._waiting.popleft())
            lines.append(text)
            budget -= len(text)
        if not lines:
            return
        try:
            self._write("".join(lines))
        except OSError as error:
            self.ended = True
            self._waiting.clear()
            log.warning("BlackBoxEnded: %s cannot be written: %s; the agent goes on", self.folder, error.strerror)

    def _text(self, taken: Taken | int | str) -> str:
        if isinstance(taken, str):
            return taken
        if isinstance(taken, int):
            self.left_out += taken
            self._framed_s.clear()
            return blackbox.gap(taken)
        machine, at_s, event, after, commands = taken
        text = "" if event is None else blackbox.step(machine, at_s, event, commands)
        framed_s = self._framed_s.get(machine)
        if event is None or framed_s is None or at_s - framed_s >= FRAME_S:
            self._framed_s[machine] = at_s
            text += blackbox.key_frame(machine, at_s, after, was_set=event is None)
        return text

    def _write(self, text: str) -> None:
        if self._size + len(text) > self.part_bytes:
            self._begin()
        with self._file().open("a", encoding="ascii") as out:
            out.write(text)
        self._size += len(text)

    def _begin(self) -> None:
        """Begin the next file and remove the oldest ones."""
        self.folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        files = parts(self.folder)
        for old in files[: max(0, len(files) - PARTS + 1)]:
            old.unlink(missing_ok=True)
        self._number = max(self._number, number_of(files[-1]) if files else 0) + 1
        text = blackbox.header({**self.facts, "to_wall_s": wall_us() / 1e6})
        with self._file().open("x", encoding="ascii") as out:
            out.write(text)
        self._size = len(text)
        self._framed_s.clear()

    def _file(self) -> Path:
        return self.folder / f"box-{self._number:08d}.log"


def parts(folder: Path) -> list[Path]:
    """Return the files of a ring, the oldest first."""
    return sorted(file for file in folder.glob("box-*.log") if file.stem[len("box-") :].isdigit())


def number_of(file: Path) -> int:
    """Return the number of a file of a ring."""
    return int(file.stem[len("box-") :])


def digest_of_core() -> str:
    """Return the digest that names this installation's core."""
    root = Path(robot_offload_core.__file__).parent
    return blackbox.digest((file.relative_to(root).as_posix(), file.read_bytes()) for file in root.rglob("*.py"))


def of(configuration: Configuration, incarnation: str) -> BlackBox | None:
    """Return the box that a configuration asks for; None if it is turned off."""
    side, mib = configuration["side"], configuration["black_box_mib"]
    if not mib:
        return None
    total = (mib if side == "robot" else min(mib, CLOUD_MIB)) << 20
    facts = {
        "side": side,
        "uid": configuration["uid"],
        "process": incarnation,
        "release": release(),
    }
    return BlackBox(state_dir(configuration) / "blackbox" / side, total, facts)
