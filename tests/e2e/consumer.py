"""The recorder's process, followed: what it hears is known while the story goes on, what it writes is judged later."""

from __future__ import annotations

import dataclasses
import json
import os
import select
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Final

from robot_offload_lab.judge.recording import LINES, Arrival, RunInfo
from robot_offload_lab.show.watch import LiveRun
from robot_offload_lab.wire.loop import steady_s
from robot_offload_lab.wire.options import LinkOptions
from tests.e2e.waiting import eventually

LOOK_S: Final = 0.05
GRACE_S: Final = 60.0
WHEELCHAIR: Final = {
    "state": "/wheelchair/state", "account": "/passenger/account", "restored": "/localiser/account",
}  # fmt: skip
"""The accounts of the applications that drive; others have no such topics."""


class Consumer:
    """A recorder that runs. A thread follows its live stream, because a story waits for other things as well."""

    def __init__(
        self, child: subprocess.Popen[bytes], file: Path, outputs: tuple[str, ...], threshold_ms: float
    ) -> None:
        """Follows a recorder.

        Args:
            child: its process, with pipes.
            file: what it writes.
            outputs: the topics that it listens to.
            threshold_ms: loop latency up to which the link is good.
        """
        self.file = file
        self.watch = LiveRun(threshold_ms=threshold_ms, outputs=outputs)
        self.heard: dict[str, int] = {}
        self._child = child
        self._gate = threading.Lock()
        self._over = False
        self._reader = threading.Thread(target=self._follow, name="consumer", daemon=True)
        self._reader.start()

    @staticmethod
    def command(
        file: Path, outputs: Mapping[str, str], link: LinkOptions | None, accounts: Mapping[str, str] = WHEELCHAIR
    ) -> list[str]:
        """How it is started."""
        command = [sys.executable, "-m", "robot_offload_lab.judge.recorder", str(file)]
        for name, topic in accounts.items():
            command += [f"--{name}", topic]
        for topic, type_name in outputs.items():
            command += ["--topic", f"{topic}={type_name}"]
        return [*command, "--link", json.dumps(dataclasses.asdict(link))] if link else command

    def begin(self, run: RunInfo) -> None:
        """From this moment on the recording counts."""
        self.watch.start_s = run.start_s
        self._tell({"start": dataclasses.asdict(run)})

    def end(self, t_s: float) -> None:
        """Closes the recording."""
        self._tell({"end": t_s})
        try:
            self._child.wait(GRACE_S)
        except subprocess.TimeoutExpired:
            self._child.kill()
        self.kill()

    def kill(self) -> None:
        """Ends the process; legal at any time."""
        self._over = True
        if self._child.poll() is None:
            self._child.kill()
        self._child.wait()
        self._reader.join(GRACE_S)
        for pipe in (self._child.stdin, self._child.stdout):
            if pipe is not None:
                with suppress(OSError):
                    pipe.close()

    def rest(self, seconds: float) -> None:
        """Lets time pass."""
        assert self._child.poll() is None, "the recorder has ended"
        time.sleep(seconds)

    def until(self, condition: Callable[[], bool], what: str, patience_s: float, instead: Callable[[], object]) -> None:
        """Waits for something that was heard."""

        def look() -> bool:
            assert self._child.poll() is None, "the recorder has ended"
            with self._gate:
                return condition()

        eventually(look, what, patience_s=patience_s, instead=instead, every_s=LOOK_S)

    def _tell(self, command: Mapping[str, object]) -> None:
        assert self._child.stdin is not None
        with suppress(BrokenPipeError):  # it has ended, which is noticed elsewhere
            self._child.stdin.write(json.dumps(command).encode() + b"\n")
            self._child.stdin.flush()

    def _follow(self) -> None:
        assert self._child.stdout is not None
        descriptor, unread = self._child.stdout.fileno(), b""
        while not self._over:
            if select.select([descriptor], [], [], LOOK_S)[0]:
                data = os.read(descriptor, 1 << 16)
                if not data:
                    return
                *lines, unread = (unread + data).split(b"\n")
                with self._gate:
                    for line in lines:
                        self._take(line.decode(errors="replace"))
                    self.watch.attend(steady_s())

    def _take(self, line: str) -> None:
        self.watch.take(line)
        with suppress(ValueError):  # what the recorder tells beside its records
            record = LINES.decode(line)
            if isinstance(record, Arrival):
                self.heard[record.site] = self.heard.get(record.site, 0) + 1
