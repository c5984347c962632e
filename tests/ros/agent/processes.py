"""Starts the processes of a test in sessions of their own and ends every one of them, whatever happened.

Also when the test itself is killed: what it left would publish beside the next run's replicas, under the same names.
"""

import os
import signal
import subprocess
import tempfile
import time
import uuid
from collections.abc import Sequence
from pathlib import Path

from robot_offload_lab.run import marked

END_S = 60.0
"""A killed process has ended by then: on a busy machine it waits for its turn to die."""
LOOK_S = 0.02


class Processes:
    """The processes of one world."""

    def __init__(self, folder: Path, environment: dict[str, str]) -> None:
        self.folder = folder
        self.mark = uuid.uuid4().hex
        inherited = {key: value for key, value in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}
        cache = {"PYTHONPYCACHEPREFIX": str(Path(tempfile.gettempdir()) / "robot-offload-tests-pycache")}
        self.environment = {**inherited, **cache, **environment, marked.MARK: self.mark}  # compiling is half of a start
        self.started: list[subprocess.Popen[bytes]] = []
        self.warden: subprocess.Popen[bytes] | None = None

    def start(
        self,
        name: str,
        command: Sequence[str],
        namespace: str = "",
        environment: dict[str, str] | None = None,
        talks: bool = False,
    ) -> subprocess.Popen[bytes]:
        """Starts a command; its output goes to NAME.log, or with `talks` through pipes to the test.

        `namespace` is a network namespace of `ip netns`.
        """
        if self.warden is None:
            self.warden = marked.start_warden(self.mark)
        inside = ["ip", "netns", "exec", namespace] if namespace else []
        with (self.folder / f"{name}.log").open("ab") as log:
            process = subprocess.Popen(
                [*inside, *command], env={**self.environment, **(environment or {})},
                stdin=subprocess.PIPE if talks else subprocess.DEVNULL,
                stdout=subprocess.PIPE if talks else log, stderr=log, start_new_session=True,
            )  # fmt: skip
        self.started.append(process)
        return process

    def log(self, name: str) -> str:
        """What a process has said so far."""
        path = self.folder / f"{name}.log"
        return path.read_text(errors="replace") if path.exists() else ""

    def logs(self, last: int = 60) -> str:
        """The last lines of every log, for the message of a failed test."""
        parts = [
            f"--- {path.name}\n" + "\n".join(path.read_text(errors="replace").splitlines()[-last:])
            for path in sorted(self.folder.glob("*.log"))
        ]
        return "\n".join(parts)

    def close(self) -> list[str]:
        """Kills every process group; returns what is alive afterwards, by number and program: it must be nothing."""
        for process in self.started:
            try:
                os.killpg(process.pid, signal.SIGKILL)
            except ProcessLookupError:
                continue
        end_s = time.monotonic() + END_S
        for process in self.started:
            process.wait(END_S)
        while (left := marked.named(marked.find(self.mark))) and time.monotonic() < end_s:
            time.sleep(LOOK_S)
        if self.warden is not None:
            marked.dismiss(self.warden)
        return left
