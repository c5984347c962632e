"""The wire between a robot and the network: steers the process that carries its frames."""

from __future__ import annotations

import json
import socket
import statistics
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

from robot_offload_lab.cluster import netns, processes
from robot_offload_lab.cluster.errors import ClusterError

Cut = Literal["both", "to_cloud", "to_robot"]
SHORTEST_STALL_S = 0.04
PATIENCE = 20.0  # seconds; a start takes a tenth of one


class Wire:
    """Delay, jitter, loss, rate and cuts of one robot's link, changed while it runs.

    All values are of one way and hold for both. Frames never overtake each other.
    """

    def __init__(self, control: Path, process: subprocess.Popen[bytes] | None = None) -> None:
        self._control = control
        self._process = process

    @classmethod
    def start(cls, control: Path, place: str, robot: str, cloud: str, *, realtime: bool, die_with_us: bool) -> Wire:
        """Start the process.

        Args:
            control: Path of the socket over which it is steered.
            place: Network namespace of both interfaces.
            robot: Interface whose other end is the robot's.
            cloud: Interface whose other end is the network's.
            realtime: With real-time priority, so that a busy machine adds less delay.
            die_with_us: It ends with this thread.
        """
        program = str(Path(__file__).with_name("wire_process.py"))
        command = [*netns.into(place), sys.executable, "-I", "-S", program, f"--control={control}"]
        command += [f"--robot={robot}", f"--cloud={cloud}", *(["--realtime"] if realtime else [])]
        control.unlink(missing_ok=True)
        log = control.with_suffix(".log")
        process = processes.spawn(command, log, die_with_us=die_with_us)
        wire = cls(control, process)
        deadline = time.monotonic() + PATIENCE
        while True:
            try:
                wire.state()
                return wire
            except OSError:
                if process.poll() is not None or time.monotonic() > deadline:
                    raise ClusterError(f"The wire does not start: {log.read_text()[-2000:]}") from None
                time.sleep(0.01)

    def set(
        self,
        *,
        delay_ms: float | None = None,
        jitter_ms: float | None = None,
        loss_pct: float | None = None,
        rate_kbit: float | None = None,
        cut: Cut | Literal["keep"] | None = "keep",
    ) -> None:
        """Change the link from now on; what is not named stays, and a recording that plays ends.

        Args:
            delay_ms: Of each frame, one way.
            jitter_ms: Standard deviation of the delay.
            loss_pct: Percentage of frames that are lost, each way.
            rate_kbit: Kilobits per second each way; 0 for no limit. Half a second of frames waits, more is lost.
            cut: None heals; "both", "to_cloud", "to_robot" name the way on which nothing passes any more.
        """
        named = {"delay_ms": delay_ms, "jitter_ms": jitter_ms, "loss_pct": loss_pct, "rate_kbit": rate_kbit}
        order: dict[str, Any] = {name: value for name, value in named.items() if value is not None}
        if cut != "keep":
            order["cut"] = cut
        self._ask({"set": order})

    def play(self, trace: Path) -> float:
        """Play a recorded link from its beginning; afterwards the values of `set` hold again.

        A round trip counts half for each way. What is sent during a stall arrives at its end, both ways.

        Args:
            trace: One round trip in ms per line, measured back to back; or CSV `t_s,rtt_ms`, empty where it was lost.

        Returns:
            The length of the recording in seconds.
        """
        ends, round_trips = read_trace(trace.read_text().splitlines())
        known = [each for each in round_trips if each is not None]
        stall = max(SHORTEST_STALL_S, 3 * statistics.median(known)) if known else SHORTEST_STALL_S
        self._ask({"recording": {"ends": ends, "round_trips": round_trips, "stall": stall}})
        return ends[-1]

    def state(self) -> dict[str, Any]:
        """Its settings, whether a recording plays, and the frames [passed, dropped] of each way."""
        return self._ask({})

    def stop(self) -> None:
        """End the process; nothing passes any more."""
        processes.kill(self._control.parent)
        self.reap()

    def reap(self) -> None:
        """Wait for the process, which has been killed."""
        if self._process is not None:
            self._process.wait()

    def _ask(self, order: dict[str, Any]) -> dict[str, Any]:
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as talk:
            talk.settimeout(PATIENCE)
            talk.connect(str(self._control))
            talk.sendall(json.dumps(order).encode() + b"\n")
            answer = talk.makefile().readline()
        if not answer:
            raise ClusterError(f"The wire refuses {order}; see {self._control.with_suffix('.log')}")
        return dict(json.loads(answer))


def read_trace(lines: Sequence[str]) -> tuple[list[float], list[float | None]]:
    """When each sample of a recording ends, and its round trip, all in seconds.

    Args:
        lines: Of the file; see `Wire.play`.
    """
    lines = [line.strip() for line in lines if line.strip() and not line.startswith("#")]
    if lines and lines[0].startswith("t_s"):
        rows = [line.split(",") for line in lines[1:]]
        begins = [float(row[0]) for row in rows]
        lengths = [float(row[1]) / 1000 if row[1] else None for row in rows]
        last = begins[-1] + (lengths[-1] or 0.0) if rows else 0.0
        ends = [each - begins[0] for each in [*begins[1:], last]] if rows else []
        return _checked(ends, lengths)
    total, ends = 0.0, []
    times: list[float | None] = [float(line) / 1000 for line in lines]
    for each in times:
        total += each or 0.0
        ends.append(total)
    return _checked(ends, times)


def _checked(ends: list[float], times: list[float | None]) -> tuple[list[float], list[float | None]]:
    if not ends:
        raise ClusterError("The recording holds no sample: one round trip in ms per line, or CSV t_s,rtt_ms")
    return ends, times
