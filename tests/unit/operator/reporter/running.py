"""The reporter as a process, with its files and its address."""

from __future__ import annotations

import itertools
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.error import HTTPError
from urllib.request import Request, urlopen

PROOF = "known-to-the-pods-of-one-robot"
PATIENCE_S = 60.0
"""For what must happen, on however busy a machine."""


class Running:
    """The process, its files and its address."""

    def __init__(
        self, folder: Path, kubeconfig: Path, namespace: str = "ward", robot: str = "wheelchair-7", **more: str
    ) -> None:
        self.state_file = folder / "state.json"
        self.handover_file = folder / "handover"
        environment = {
            "NAMESPACE": namespace,
            "LEASE_NAME": f"{robot}-robot",
            "ROBOT_NAME": robot,
            "STATE_FILE": str(self.state_file),
            "HANDOVER_FILE": str(self.handover_file),
            "HANDOVER_PROOF": PROOF,
            "PORT": "0",
            "KUBECONFIG": str(kubeconfig),
            **more,
        }
        self._content: dict[str, Any] = {}
        self._writing = threading.Lock()
        self._agent: Beating | None = None
        self.log = (folder / "log").open("w+")
        self.process = subprocess.Popen(
            [sys.executable, "-m", "robot_offload.reporter"], env={**os.environ, **environment}, stderr=self.log
        )
        try:
            self.port = self._port(folder / "log")
        except BaseException:
            self.stop()
            raise
        self.url = f"http://127.0.0.1:{self.port}"

    def _port(self, log: Path) -> int:
        def port() -> int | None:
            assert self.process.poll() is None, log.read_text()
            whole = log.read_text().rpartition("\n")[0].splitlines()  # the last line may be half written
            lines = [json.loads(line) for line in whole if line.startswith("{")]
            served = [address for line in lines if line["event"] == "serving" for address in line["addresses"]]
            return next((port for host, port in served if "." in host), None)  # the other one is IPv6

        return int(eventually(port))

    def write(self, content: str) -> None:
        """Writes the state file once; after some seconds without another write its agent counts as silent."""
        with self._writing:
            new = self.state_file.with_suffix(".new")
            new.write_text(content)
            new.replace(self.state_file)

    def live(self, content: str) -> None:
        """Writes the state file again and again, as a living agent does, until the reporter is stopped."""
        self._content = json.loads(content)
        self.write(content)
        if self._agent is None:
            self._agent = Beating(self, lambda number: json.dumps({**self._content, "written": f"again {number}"}))
            self._agent.start()

    def ask(self, path: str, method: str = "GET") -> tuple[int, str]:
        try:
            with urlopen(Request(self.url + path, method=method), timeout=PATIENCE_S) as answer:
                return answer.status, answer.read().decode()
        except HTTPError as error:
            with error:
                return error.code, error.read().decode()

    def stop(self) -> int:
        self.process.send_signal(signal.SIGTERM)
        try:
            return self.process.wait(PATIENCE_S)
        finally:
            if self._agent is not None:
                self._agent.end()
            self.process.kill()
            self.process.wait()
            self.log.close()


class Beating(threading.Thread):
    """Writes the cloud agent's state as the agent does, five times a second: one that is written once is soon silent.

    Attributes:
        told: makes the text of the n-th state; replaced while it runs, the next state is another one.
    """

    def __init__(self, reporter: Running, told: Callable[[int], str]) -> None:
        super().__init__(daemon=True)
        self.told = told
        self._reporter = reporter
        self._over = threading.Event()

    def run(self) -> None:
        for number in itertools.count(1):
            self._reporter.write(self.told(number))
            if self._over.wait(0.2):
                return

    def end(self) -> None:
        """Ends it."""
        self._over.set()
        self.join()


def eventually(found: Callable[[], Any], within_s: float = PATIENCE_S) -> Any:
    end = time.monotonic() + within_s
    while time.monotonic() < end:
        if value := found():
            return value
        time.sleep(0.05)
    raise AssertionError(f"not within {within_s} s")
