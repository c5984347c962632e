"""The wire between a robot and the network: steers the process that carries its frames."""

from __future__ import annotations

import dataclasses
import json
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, Literal

from robot_offload_lab.cluster import netns, processes
from robot_offload_lab.cluster.errors import ClusterError
from robot_offload_lab.links.recorded import TraceError, load_trace
from robot_offload_lab.wire.options import LinkOptions

Cut = Literal["both", "to_cloud", "to_robot"]
PATIENCE = 60.0  # seconds; a start takes a tenth of one, on a busy machine many


class RobotWire:
    """Delay, jitter, loss, rate and cuts of one robot's link, changed while it runs.

    All values are one-way and apply to both directions. Frames never overtake each other.
    """

    def __init__(self, control: Path, process: subprocess.Popen[bytes] | None = None) -> None:
        self._control = control
        self._process = process

    @classmethod
    def start(
        cls, control: Path, place: str, robot: str, cloud: str, *, realtime: bool, die_with_us: bool
    ) -> RobotWire:
        """Start the process.

        Args:
            control: Path of the socket over which it is steered.
            place: Network namespace of both interfaces.
            robot: Interface whose other end is the robot's.
            cloud: Interface whose other end is the network's.
            realtime: With real-time priority, so that a busy machine adds less delay.
            die_with_us: It ends with this thread.
        """
        program = "robot_offload_lab.cluster.wire_process"
        command = [*netns.into(place), sys.executable, "-m", program, f"--control={control}"]
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
        """Change the link from now on; settings that are not given stay, and a playing recording ends.

        On a followed link the given settings replace that link's, until `follow` is called again.

        Args:
            delay_ms: Delay of each frame, one way.
            jitter_ms: Standard deviation of the delay.
            loss_pct: Percentage of frames that are lost, each way.
            rate_kbit: Kilobits per second each way; 0 for no limit. Half a second of frames waits, more is lost.
            cut: None heals; "both", "to_cloud", "to_robot" name the direction in which nothing passes.
        """
        named = {"delay_ms": delay_ms, "jitter_ms": jitter_ms, "loss_pct": loss_pct, "rate_kbit": rate_kbit}
        order: dict[str, Any] = {name: value for name, value in named.items() if value is not None}
        if cut != "keep":
            order["cut"] = cut
        self._ask({"set": order})

    def play(self, trace: Path) -> float:
        """Play a recorded link from its beginning; afterwards the values of `set` hold again.

        A round trip counts half for each direction. Frames sent during a stall arrive at its end, both ways.

        Args:
            trace: One round trip in ms per line, measured back to back; or CSV `t_s,rtt_ms`, empty where it was lost.

        Returns:
            The length of the recording in seconds.

        Raises:
            ClusterError: The file is not a recording.
        """
        try:
            length_s = load_trace(trace).duration_s
        except TraceError as error:
            raise ClusterError(str(error)) from error
        self._ask({"play": str(trace.resolve())})
        return length_s

    def follow(self, link: LinkOptions) -> None:
        """Behave as this link usually does, without its outages and slow phases, until `start_schedule`.

        Raises:
            WireError: the options cannot be understood.
        """
        link.schedule()
        self._ask({"follow": dataclasses.asdict(link)})

    def start_schedule(self) -> float:
        """Start the schedule of the followed link; return that moment, in seconds of the steady clock."""
        return float(self._ask({"start": True})["started_s"])

    def state(self) -> dict[str, Any]:
        """Return its settings, whether a recording plays, and the frames [passed, dropped] of each way."""
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
