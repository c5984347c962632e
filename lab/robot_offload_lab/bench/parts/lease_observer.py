"""An observer of the lease, outside the agents: a third Zenoh client with a certificate of its own at the cloud agent.

It dials the cloud agent's two listeners directly, not through the emulated link, and writes down every envelope that
leaves the cloud and every beat of the robot that has reached it. Whether an envelope left after its lease is reckoned
later, in `analysis.lease`.
"""

from __future__ import annotations

import argparse
import json
import queue
import signal
from collections.abc import Callable, Sequence
from pathlib import Path
from types import FrameType
from typing import Any, Final

import zenoh

from robot_offload_core.fence.envelope import LAYOUT
from robot_offload_lab.bench.observed import LINES, Departed, Observation, Reached
from robot_offload_lab.wire.loop import steady_s

WAIT_S: Final = 0.1
KIND: Final = "mixed_rel=1"
"""Streams and datagrams on one connection, as the agents' sessions are: a listener refuses any other kind."""


class Observer:
    """Two sessions; what they hear goes through a queue to the one thread that writes."""

    def __init__(self, options: argparse.Namespace) -> None:
        self._heard: queue.SimpleQueue[Observation] = queue.SimpleQueue()
        self._stop = False
        prefix = f"robot_offload/{options.uid}"
        self._sessions = [
            listen(options, options.pulse, f"{prefix}/robot/pulse/beat", self._on_beat),
            listen(options, options.data, f"{prefix}/cloud/data/out/*", self._on_envelope),
        ]

    def run(self, path: Path) -> None:
        """Write until SIGTERM."""
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._on_signal)
        with path.open("w", encoding="utf-8", buffering=1) as file:
            while not self._stop:
                try:
                    file.write(LINES.encode(self._heard.get(timeout=WAIT_S)) + "\n")
                except queue.Empty:
                    continue
        for session in self._sessions:
            session.close()

    def _on_signal(self, _number: int, _frame: FrameType | None) -> None:
        self._stop = True

    def _on_beat(self, sample: Any) -> None:
        self._heard.put(Reached(steady_s(), sample.payload.to_bytes().decode("ascii", "replace")))

    def _on_envelope(self, sample: Any) -> None:
        t_s = steady_s()
        # The link puts a number of its own in front of the header.
        attachment = sample.attachment.to_bytes() if sample.attachment is not None else b""
        header = attachment[-LAYOUT.size :].hex()
        self._heard.put(Departed(t_s, str(sample.key_expr).rpartition("/")[2], header))


def listen(options: argparse.Namespace, address: str, key: str, heard: Callable[[Any], None]) -> Any:
    """Open a session with a listener of the cloud agent and subscribe to a key."""
    session = zenoh.open(zenoh.Config.from_json5(config(options, f"quic/{address}?{KIND}")))
    session.declare_subscriber(key, heard)
    return session


def config(options: argparse.Namespace, endpoint: str) -> str:
    """Return the configuration of a client session that waits for its listener."""
    tls = {
        "root_ca_certificate": options.ca,
        "enable_mtls": True,
        "connect_certificate": options.certificate,
        "connect_private_key": options.private_key,
    }
    retry = {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 2}
    return json.dumps(
        {
            "mode": "client",
            "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
            "listen": {"endpoints": []},
            "connect": {"endpoints": [endpoint], "timeout_ms": -1, "exit_on_failure": False, "retry": retry},
            "transport": {"shared_memory": {"enabled": False}, "link": {"tls": tls}},
        }
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Open the sessions, which waits for the cloud agent, then observe until SIGTERM."""
    parser = argparse.ArgumentParser(prog="python -m robot_offload_lab.bench.parts.lease_observer", description=__doc__)
    parser.add_argument("file", type=Path, help="what to write")
    for name, text in (
        ("uid", "of the RobotOffload"),
        ("pulse", "HOST:PORT where the cloud agent hears beats"),
        ("data", "HOST:PORT of its data session"),
        ("ca", "the authority that signed the cloud's certificate"),
        ("certificate", "this client's"),
        ("private-key", "this client's"),
    ):
        parser.add_argument(f"--{name}", required=True, help=text)
    options = parser.parse_args(arguments)
    Observer(options).run(options.file)


if __name__ == "__main__":
    main()
