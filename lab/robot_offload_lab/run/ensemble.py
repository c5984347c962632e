"""The programs of one run together: started, followed by what they print, waited for, and ended.

The demo, and the worlds and stages of the bench, are built on this. They interpret the printed lines.
"""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final

from robot_offload.errors import RobotOffloadError
from robot_offload_lab.run.pipes import Pipes
from robot_offload_lab.run.processes import Processes, Program
from robot_offload_lab.wire.loop import steady_s

LOOK_S: Final = 0.02
"""How long one look waits for a line; conditions are checked as often."""
_TAIL: Final = 6
"""Lines of each log that an error shows."""


class StartError(RobotOffloadError):
    """A run did not get as far as it should; the message has the last log lines of the processes."""

    def __init__(self, problem: str, said: Mapping[str, Sequence[str]], logs: Path) -> None:
        self._lines = [problem]
        for name, lines in said.items():
            self._lines += [f"  {name}: {line}" for line in lines]
        self._lines.append(f"All logs are in {logs}; correct what they name, then run the same command again")
        super().__init__("\n".join(self._lines))

    @property
    def lines(self) -> tuple[str, ...]:
        """The problem, the last log lines of the processes, what to do."""
        return tuple(self._lines)


class Ensemble:
    """Programs that run together. Needs `Processes`, whose exit ends them."""

    def __init__(self, processes: Processes, logs: Path, on_line: Callable[[str, str], None]) -> None:
        """Prepare; start nothing.

        Args:
            processes: starts and ends them.
            logs: folder of their logs, for messages.
            on_line: called with the name of a program and each line that the program prints.
        """
        self.processes = processes
        self.pids: dict[str, int] = {}
        self._logs = logs
        self._on_line = on_line
        self._pipes = Pipes()

    def __contains__(self, name: str) -> bool:
        return name in self.pids

    def start(self, program: Program) -> subprocess.Popen[bytes]:
        """Start a program, and follow it if it is piped.

        Raises:
            ProcessError: the program cannot be started.
        """
        child = self.processes.start(program)
        self.pids[program.name] = child.pid
        if program.piped:
            self._pipes.add(program.name, child)
        return child

    def command(self, name: str, command: Mapping[str, object]) -> None:
        """Write a line of JSON to a program."""
        self._pipes.command(name, command)

    def until(self, condition: Callable[[], bool], what: str, patience_s: float, words_of: Sequence[str] = ()) -> None:
        """Wait for a condition on what the programs print.

        Args:
            condition: asked after each look.
            what: the condition in words, for the error.
            patience_s: how long to wait, seconds.
            words_of: programs whose last log lines the error shows; empty: all.

        Raises:
            StartError: the condition did not come true, or a program ended.
        """
        give_up_s = steady_s() + patience_s
        while not condition():
            self.look(LOOK_S)
            late = steady_s() > give_up_s
            self.check(what, f"not seen within {patience_s:.0f} s" if late else None, words_of)

    def check(self, what: str, missing: str | None = None, words_of: Sequence[str] = ()) -> None:
        """Make sure that the run can go on.

        Args:
            what: what the run waits for, in words.
            missing: why it stopped waiting; None: it still waits.
            words_of: programs whose last log lines the error shows; empty: all.

        Raises:
            StartError: a program has ended, or something is missing.
        """
        ended = self.processes.first_ended()
        if ended is not None:
            problem = f"{ended.describe()} while the run waited until {what}"
            raise StartError(problem, {ended.name: self.processes.last_lines(ended.name)}, self._logs)
        if missing is not None:
            words = {name: self.processes.last_lines(name)[-_TAIL:] for name in words_of or tuple(self.pids)}
            raise StartError(f"Waited in vain until {what}: {missing}", words, self._logs)

    def rest(self, seconds: float) -> None:
        """Let time pass, following what the programs print."""
        end_s = steady_s() + seconds
        while (left_s := end_s - steady_s()) > 0:
            self.look(min(left_s, LOOK_S))

    def look(self, seconds: float) -> None:
        """Read what was printed; wait up to `seconds` for output."""
        for name, line in self._pipes.look(seconds):
            self._on_line(name, line)

    def finish(self, name: str, last: Mapping[str, object] | None, grace_s: float) -> None:
        """End one program: by a last command and the end of its standard input, by SIGKILL after `grace_s`."""
        self.look(0.0)
        if last is not None:
            self.command(name, last)
        self._pipes.close(name)
        self.processes.finish(name, grace_s)
        del self.pids[name]
