"""What process 1 of a discovery server's container does, with a server and a `sleep` that only say what they do.

Real servers: tests/ros/test_discovery_servers.py; the real image: tests/integration/test_images_ours.py.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from robot_offload.transport import discovery
from robot_offload_lab.images.ours import ROOT

SERVE = ROOT / "images" / "discovery" / "serve"
WAIT_S = 60.0
SERVER = """#!/bin/bash
trap 'echo server ended; exit 3' TERM
echo "server $*"
while :; do read -r -t 0.05 _ <> <(:); done
"""
LASTING_SLEEP = """#!/bin/bash
trap 'echo woken; exit 0' TERM
echo "sleep $1"
while :; do read -r -t 0.05 _ <> <(:); done
"""


class Serve:
    """`serve` as the image runs it, in a folder of the test."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.home = folder / "home"
        self.home.mkdir()
        self.program("fast-discovery-server", SERVER)
        self.program("sleep", '#!/bin/bash\necho "sleep $1"\n')

    def program(self, name: str, text: str) -> None:
        """Writes a program that stands before all others of its name."""
        path = self._folder / name
        path.write_text(text, encoding="utf-8")
        path.chmod(0o755)

    def start(self) -> None:
        """Starts it."""
        environment = {"PATH": f"{self._folder}:{os.environ['PATH']}", "HOME": str(self.home)}
        with self._log.open("wb") as log:
            command = (str(SERVE), "fast-discovery-server", "-i", "0")
            self.process = subprocess.Popen(command, env=environment, stdout=log, stderr=log, start_new_session=True)

    def said(self) -> list[str]:
        """The lines of all programs so far."""
        return self._log.read_text(encoding="utf-8").splitlines() if self._log.exists() else []

    def until(self, beginning: str) -> None:
        """Waits for a line."""
        deadline = time.monotonic() + WAIT_S
        while not any(line.startswith(beginning) for line in self.said()):
            assert time.monotonic() < deadline, self.said()
            time.sleep(0.02)

    def kill(self) -> None:
        """Ends whatever still runs."""
        if hasattr(self, "process"):
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self.process.pid, signal.SIGKILL)
            self.process.wait(WAIT_S)

    @property
    def _log(self) -> Path:
        return self._folder / "log"


@pytest.fixture
def serve(tmp_path: Path) -> Iterator[Serve]:
    made = Serve(tmp_path)
    yield made
    made.kill()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_the_server_is_ended_and_then_its_place_stays_empty(serve: Serve, number: signal.Signals) -> None:
    serve.start()
    serve.until("server -i 0")
    serve.process.send_signal(number)
    assert serve.process.wait(WAIT_S) == 0
    assert serve.said() == [f"server -i 0 -x {SERVE.parent}/server.xml", "server ended", f"sleep {discovery.GONE_S}"]


def test_a_server_that_dies_ends_the_container_with_its_code(serve: Serve) -> None:
    serve.program("fast-discovery-server", "#!/bin/bash\nkill -KILL $$\n")
    serve.start()
    assert serve.process.wait(WAIT_S) == 128 + signal.SIGKILL
    assert not any(line.startswith("sleep") for line in serve.said()), "the kubelet starts the next one, which waits"


def test_a_server_that_comes_after_a_dead_one_waits_until_that_is_forgotten(serve: Serve) -> None:
    (serve.home / "server-was-here").touch()
    serve.start()
    serve.until("server -i 0")
    assert serve.said()[0] == f"sleep {discovery.GONE_S}"


def test_sigterm_ends_it_also_while_it_waits_for_its_turn(serve: Serve) -> None:
    (serve.home / "server-was-here").touch()
    serve.program("sleep", LASTING_SLEEP)
    serve.start()
    serve.until("sleep")
    serve.program("sleep", "#!/bin/bash\n")
    serve.process.terminate()
    assert serve.process.wait(WAIT_S) == 0
    assert not any(line.startswith("server") for line in serve.said())
