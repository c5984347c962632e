"""What the emulated link itself costs: datagrams of its own through the same wire, from the cloud's end to the robot's.

For each payload size in turn it sends as many datagrams as a message of that size needs on the way, and writes down
when the last of them has arrived.
"""

from __future__ import annotations

import argparse
import os
import select
import signal
import socket
import sys
from contextlib import suppress
from pathlib import Path
from typing import Final

from robot_offload_lab.bench.observed import LINES, Hop
from robot_offload_lab.wire.loop import steady_s

DATAGRAM_BYTES: Final = 1150
"""What the sessions put into one datagram (the transport's own MTU for QUIC)."""
OVERHEAD_BYTES: Final = 150
"""Headers of message, envelope and session around a payload, as far as the number of datagrams is concerned."""
MARK_BYTES: Final = 8
PATIENCE_S: Final = 1.0
HOST: Final = "127.0.0.1"


def datagrams(size: int) -> int:
    """Return how many datagrams carry a message with this payload."""
    return -(-(size + OVERHEAD_BYTES) // DATAGRAM_BYTES)


def datagram_socket(namespace: str) -> socket.socket:
    """Return a socket that stays in the network namespace in which it is made; empty for this process's own."""
    if not namespace:
        return socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    with Path("/proc/self/ns/net").open(encoding="ascii") as home, Path(namespace).open(encoding="ascii") as other:
        os.setns(other.fileno(), os.CLONE_NEWNET)
        try:
            return socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        finally:
            os.setns(home.fileno(), os.CLONE_NEWNET)


def measure(robot: socket.socket, cloud: socket.socket, number: int, size: int) -> float | None:
    """Send one message's worth to the robot's end; return the milliseconds until all of it has arrived.

    Args:
        robot: the robot's end. It speaks first, each time: the relay learns the way back from it.
        cloud: the cloud's end.
        number: of this measurement, so that nothing late of an earlier one is counted.
        size: payload of the message in bytes.

    Returns:
        None when something of it got lost.
    """
    mark = number.to_bytes(MARK_BYTES, "big")
    robot.send(mark)
    found = _receive(cloud, mark)
    if found is None:
        return None
    count = datagrams(size)
    datagram = mark.ljust(min(DATAGRAM_BYTES, size + OVERHEAD_BYTES), b"\0")
    sent_s = steady_s()
    for _ in range(count):
        cloud.sendto(datagram, found)
    for _ in range(count):
        if _receive(robot, mark) is None:
            return None
    return (steady_s() - sent_s) * 1e3


def _receive(end: socket.socket, mark: bytes) -> tuple[str, int] | None:
    """Wait for a datagram with this mark; return where it came from, None when none comes."""
    while select.select([end], [], [], PATIENCE_S)[0]:
        with suppress(ConnectionRefusedError):  # reported by the kernel for an earlier datagram
            data, sender = end.recvfrom(65535)
            if data.startswith(mark):
                return str(sender[0]), int(sender[1])
    return None


def main() -> None:
    """Measure until SIGTERM."""
    parser = argparse.ArgumentParser(prog="python -m robot_offload_lab.bench.parts.hop", description=__doc__)
    parser.add_argument("file", type=Path, help="what to write")
    parser.add_argument("--dial", type=int, required=True, help="port of the wire on the robot's end")
    parser.add_argument("--serve", type=int, required=True, help="port on the cloud's end")
    parser.add_argument("--host", default=HOST, help="address of both ends, or of the cloud's where they are two hosts")
    parser.add_argument("--robot-net", default="", help="file of the robot's network namespace; empty: ours")
    parser.add_argument("--cloud-net", default="", help="file of the cloud's network namespace; empty: ours")
    parser.add_argument("--period", type=float, required=True, help="seconds between two measurements")
    parser.add_argument("sizes", type=int, nargs="+", help="payloads in bytes")
    options = parser.parse_args()
    for stop in (signal.SIGINT, signal.SIGTERM):
        signal.signal(stop, lambda *_: sys.exit(0))
    with (
        datagram_socket(options.robot_net) as robot,
        datagram_socket(options.cloud_net) as cloud,
        options.file.open("w", encoding="utf-8", buffering=1) as file,
    ):
        cloud.bind((options.host, options.serve))
        robot.connect((options.host, options.dial))
        number = 0
        while True:
            size = options.sizes[number % len(options.sizes)]
            number += 1
            delay_ms = measure(robot, cloud, number, size)
            if delay_ms is not None:
                file.write(LINES.encode(Hop(steady_s(), size, delay_ms)) + "\n")
            select.select([], [], [], options.period)


if __name__ == "__main__":
    main()
