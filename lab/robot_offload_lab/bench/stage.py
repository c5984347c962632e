"""Programs of the bench without the product's agents around them: what the product is compared with, or built on.

A `World` runs both sides of a case; a `Stage` runs bare ROS 2 programs, on this host or on the two hosts joined by the
emulated link. What they print, one JSON object per line, is kept by name.
"""

from __future__ import annotations

import json
import os
import secrets
import shutil
import sys
import tempfile
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

from robot_offload_lab.run.ensemble import Ensemble
from robot_offload_lab.run.free import free_domains
from robot_offload_lab.run.processes import Processes, Program
from robot_offload_lab.wire.two_hosts import TwoHosts

START_PATIENCE_S: Final = 100.0
PRIORITY: Final = 4
"""SCHED_FIFO priority of everything on a stage, where requested and permitted."""
RMW: Final = "rmw_fastrtps_cpp"
_OURS: Final = ("ROS_", "FASTDDS_", "FASTRTPS_", "CYCLONEDDS_", "RMW_")
Said = dict[str, Any]


class Stage:
    """A context manager: leaving it ends all programs."""

    def __init__(
        self, folder: Path, *, realtime: bool, domain: int | None = None, hosts: TwoHosts | None = None
    ) -> None:
        """Prepare; start nothing.

        Args:
            folder: for the logs; made anew.
            realtime: whether everything runs under SCHED_FIFO where permitted.
            domain: ROS domain; None picks a free one.
            hosts: where programs with a host run; without it there is this host only.
        """
        self.folder = folder.resolve()
        self.said: dict[str, list[Said]] = {}
        self._realtime = realtime
        self._domain = domain
        self._hosts = hosts
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        shutil.rmtree(self.folder, ignore_errors=True)
        (self.folder / "logs").mkdir(parents=True)
        if self._domain is None:
            self._domain = free_domains()[0]
        self._temporary = Path(self._stack.enter_context(tempfile.TemporaryDirectory(prefix="ro-stage-")))
        run = secrets.token_hex(8)
        logs = self.folder / "logs"
        processes = self._stack.enter_context(Processes(run, logs, self._temporary))
        self.programs = Ensemble(processes, logs, self._take)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    def start(
        self, name: str, module: str, *arguments: object, host: str = "", extra: Mapping[str, str] | None = None
    ) -> None:
        """Start `python -m MODULE ARGUMENTS`.

        Args:
            name: for logs, and for its output.
            module: the program.
            arguments: its own.
            host: `robot` or `cloud` of the two hosts; empty: this host.
            extra: further variables of its environment.
        """
        enter = self._hosts.enter(host) if self._hosts is not None and host else ()
        command = (*enter, sys.executable, "-m", module, *map(str, arguments))
        # On one machine, shared memory would bypass the link.
        apart = {"FASTDDS_BUILTIN_TRANSPORTS": "UDPv4", "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"} if enter else {}
        environment = {**self._environment(), **apart, **(extra or {})}
        priority = PRIORITY if self._realtime else 0
        program = Program(name, command, self.folder, environment, piped=True, priority=priority)
        self.said[name] = []
        self.programs.start(program)

    def _environment(self) -> Mapping[str, str]:
        own = {name: value for name, value in os.environ.items() if not name.startswith(_OURS)}
        return own | {
            "ROS_DOMAIN_ID": str(self._domain),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "RMW_IMPLEMENTATION": RMW,
            "ROS_LOG_DIR": str(self.folder / "logs" / "ros"),
            "XDG_STATE_HOME": str(self._temporary / "state"),
            "PYTHONUNBUFFERED": "1",
        }

    def ask(self, name: str, command: Mapping[str, object], what: str, patience_s: float = START_PATIENCE_S) -> Said:
        """Write a line and return the next line that the program prints.

        Raises:
            StartError: no answer came, or a program ended.
        """
        known = len(self.said[name])
        self.programs.command(name, command)
        self.until(lambda: len(self.said[name]) > known, what, patience_s)
        return self.said[name][known]

    def until(self, condition: Callable[[], bool], what: str, patience_s: float = START_PATIENCE_S) -> None:
        """Wait for a condition on what the programs print.

        Raises:
            StartError: the condition did not come true, or a program ended.
        """
        self.programs.until(condition, what, patience_s)

    def rest(self, seconds: float) -> None:
        """Let time pass, following what the programs print."""
        self.programs.rest(seconds)

    def follow(self) -> None:
        """Read what has been printed, without waiting."""
        self.programs.look(0.0)

    def end(self, name: str, grace_s: float = 5.0) -> None:
        """End one program by closing its standard input, or by SIGKILL if that does not help."""
        self.programs.finish(name, None, grace_s)

    def _take(self, name: str, line: str) -> None:
        if line.startswith("{"):
            self.said[name].append(json.loads(line))
