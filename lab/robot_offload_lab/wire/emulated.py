"""An emulated network link between the robot's and the cloud's agent on one machine, in user space, without root.

For every port that the robot dials, a relay forwards datagrams (UDP, for QUIC) or byte streams (TCP, for the
TLS fallback) to the port where the cloud listens. All share one model of the link: delay, jitter, loss,
rate, outages, slow phases or a recorded trace (`wire_model`, `wire_schedule`).

    with EmulatedWire(WireConfig(forwards=(...), link=LinkOptions(delay="10ms", outages=("4/20",)))) as wire:
        wire.start_schedule()
        wire.cut("up")

or `python -m robot_offload_lab.wire.emulated --config FILE.json`; see `wire_process` for its control socket and log.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import json
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, ClassVar, Literal, Self

from robot_offload.errors import RobotOffloadError
from robot_offload_lab.wire.link import ControlError
from robot_offload_lab.wire.options import Address, Forward, LinkOptions, WireConfig
from robot_offload_lab.wire.process import WireProcess, WireProcessError

__all__ = ["Address", "EmulatedWire", "Forward", "LinkOptions", "WireConfig", "WireProcessError"]

START_TIMEOUT_S = 60.0
ANSWER_TIMEOUT_S = 30.0
STOP_GRACE_S = 20.0
"""Enough for a busy machine to start a process, to schedule it, and to let it write the end of its log."""


class EmulatedWire:
    """The wire's process as a context manager. Leaving it stops the process, or kills it if necessary."""

    MODULE: ClassVar[str] = "robot_offload_lab.wire.emulated"
    """The program that is started."""

    def __init__(self, config: WireConfig, folder: Path | None = None) -> None:
        """Prepare; start nothing.

        Args:
            config: what to emulate. An empty `control` gets a path in a temporary folder.
            folder: where that folder is made; None: the system's default.
        """
        self._config = config
        self._place = folder
        self._process: subprocess.Popen[bytes] | None = None
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._socket: socket.socket | None = None
        self._control = ""
        self._ports: dict[str, int] = {}

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def start(self) -> None:
        """Start the process and wait until its ports are open.

        Raises:
            WireError: the options of the link cannot be understood.
            WireProcessError: it did not start, for example because a port is taken.
        """
        self._config.link.schedule()  # so that a wrong option is reported here and not by the process
        self._folder = tempfile.TemporaryDirectory(prefix="ro-wire-", dir=self._place)
        folder = Path(self._folder.name)
        self._control = self._config.control or str(folder / "control.sock")
        Path(self._control).unlink(missing_ok=True)  # a socket of an earlier run would look like ours
        path = folder / "wire.json"
        path.write_text(dataclasses.replace(self._config, control=self._control).to_json(), encoding="utf-8")
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            self._socket.bind(str(folder / "asker.sock"))
            self._socket.settimeout(ANSWER_TIMEOUT_S)
            with (folder / "stderr").open("wb") as stderr:
                options = ["--config", str(path), "--parent", str(os.getpid())]
                self._process = subprocess.Popen(
                    [sys.executable, "-m", self.MODULE, *options],
                    stdin=subprocess.DEVNULL,
                    stderr=stderr,
                    start_new_session=True,  # Ctrl-C is for our caller, who ends us when it is time
                )
            self._await_ready()
            self._ports = self.status()["ports"]
        except BaseException:
            self.stop()
            raise

    def stop(self) -> None:
        """Stop the process; may be called at any time."""
        if self._process is not None:
            self._process.terminate()
            try:
                self._process.wait(STOP_GRACE_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
            self._process = None
        if self._socket is not None:
            self._socket.close()
            self._socket = None
        if self._folder is not None:
            self._folder.cleanup()
            self._folder = None

    @property
    def pid(self) -> int | None:
        """The process id; None when the process was not started."""
        return self._process.pid if self._process else None

    def port(self, name: str) -> int:
        """Return the port on which the forward `name` listens."""
        return self._ports[name]

    def start_schedule(self) -> float:
        """Start the schedule's clock; return the steady time (CLOCK_BOOTTIME) of its 0 in seconds."""
        return float(self._ask({"start": True})["started_s"])

    def set(self, **conditions: Any) -> None:
        """Put conditions on top of the schedule at once, such as `delay_ms=80` or `up={"loss": 0.1}`.

        Raises:
            ControlError: an unknown condition or a value out of range.
        """
        self._ask({"set": conditions})

    def cut(self, which: Literal["up", "down", "both"] | None) -> None:
        """Cut one direction or both; with None leave only the schedule's outages."""
        self.set(cut=which)

    def status(self) -> dict[str, Any]:
        """Return ports, counters, conditions, and when the schedule was started."""
        return self._ask({"status": True})

    def _await_ready(self) -> None:
        assert self._process is not None
        assert self._folder is not None
        deadline_s = time.monotonic() + START_TIMEOUT_S
        while not Path(self._control).is_socket():
            if self._process.poll() is not None:
                said = (Path(self._folder.name) / "stderr").read_text(errors="replace").strip()
                raise WireProcessError(said or f"the emulated link ended: code {self._process.returncode}")
            if time.monotonic() > deadline_s:
                raise WireProcessError(f"the emulated link was not ready within {START_TIMEOUT_S:g} s")
            time.sleep(0.01)

    def _ask(self, command: dict[str, Any]) -> dict[str, Any]:
        if self._socket is None:
            raise WireProcessError("the emulated link is not running; start it first")
        try:
            self._socket.sendto(json.dumps(command).encode(), self._control)
            answer: dict[str, Any] = json.loads(self._socket.recv(1 << 20))
        except OSError as error:
            raise WireProcessError(f"the emulated link does not answer: {error}") from error
        if "error" in answer:
            raise ControlError(answer["error"])
        return answer


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the wire until SIGTERM or SIGINT; 2 for a wrong configuration, 1 if it cannot start."""
    parser = argparse.ArgumentParser(prog="python -m robot_offload_lab.wire.emulated", description="An emulated link.")
    parser.add_argument("--config", type=Path, required=True, help="JSON file, see WireConfig")
    parser.add_argument("--parent", type=int, help="stop when this process is no longer the parent")
    options = parser.parse_args(arguments)
    try:
        config = WireConfig.from_json(options.config.read_text(encoding="utf-8"))
        with contextlib.suppress(KeyboardInterrupt):
            WireProcess(config, parent=options.parent).run()
    except OSError as error:
        sys.stderr.write(f"{options.config}: {error.strerror}\n")
        return 2
    except RobotOffloadError as error:
        sys.stderr.write("\n".join(error.lines) + "\n")
        return error.exit_code
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
