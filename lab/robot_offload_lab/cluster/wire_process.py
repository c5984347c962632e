"""A wire between two network interfaces, as a process of its own: delay, jitter, loss, rate, cuts, a recorded link.

Standard library only, and no import of this package: it starts in a tenth of a second. `wire.Wire` steers it.
"""

from __future__ import annotations

import argparse
import gc
import heapq
import json
import os
import random
import select
import socket
import struct
import sys
import time
from bisect import bisect_right
from typing import Any

# Of linux/if_packet.h.
SOL_PACKET, PACKET_VNET_HDR, PACKET_IGNORE_OUTGOING = 263, 15, 23
PACKET_ADD_MEMBERSHIP, PACKET_MR_PROMISC = 1, 1
ALL_PROTOCOLS = 3
LARGEST_FRAME = 70000
BURST = 64  # frames from one side before the other side and the frames that are due get their turn
BUFFER_S = 0.5  # of a link with a limited rate: what would wait longer is dropped
REALTIME_PRIORITY = 20


class Recorded:
    """A recorded link, played from a moment on.

    Args:
        ends: Seconds since the beginning at which each sample ends, rising.
        round_trips: Seconds; None where the answer was lost.
        stall: A round trip of more seconds is a stall: all that was sent meanwhile arrives at its end.
        begun: On the monotonic clock, in seconds.
    """

    def __init__(self, ends: list[float], round_trips: list[float | None], stall: float, begun: float) -> None:
        self._ends, self._round_trips, self._stall, self._begun = ends, round_trips, stall, begun

    def over(self, now: float) -> bool:
        """Whether the recording has been played to its end."""
        return now - self._begun >= self._ends[-1]

    def arrival(self, now: float) -> float | None:
        """When a frame that is sent now arrives; None when never."""
        index = bisect_right(self._ends, now - self._begun)
        round_trip = self._round_trips[index]
        if round_trip is None:
            return None
        if round_trip > self._stall:
            return self._begun + self._ends[index]
        return now + round_trip / 2


class Direction:
    """What happens to frames of one direction."""

    def __init__(self, name: str, out: socket.socket) -> None:
        self.name, self.out = name, out
        self.passed = self.dropped = 0
        self._sent = 0.0  # when the link of limited rate is free again
        self._last = 0.0  # no frame overtakes an earlier one

    def arrival(self, now: float, size: int, link: dict[str, Any], recorded: Recorded | None) -> float | None:
        """When a frame of so many bytes arrives; None when never. Seconds on the monotonic clock."""
        if link["cut"] in ("both", self.name) or (link["loss_pct"] and random.random() * 100 < link["loss_pct"]):
            return None
        sent = now
        if link["rate_kbit"]:
            if self._sent - now > BUFFER_S:
                return None
            sent = self._sent = max(self._sent, now) + size * 8 / (link["rate_kbit"] * 1000)
        if recorded is not None:
            arrives = recorded.arrival(sent)
            if arrives is None:
                return None
        else:
            spread = random.gauss(0, link["jitter_ms"]) if link["jitter_ms"] else 0.0
            arrives = sent + max(0.0, link["delay_ms"] + spread) / 1000
        self._last = max(self._last, arrives)
        return self._last


class Process:
    """Both directions, the frames under way, and the socket over which it is steered."""

    def __init__(self, robot: str, cloud: str, control: str) -> None:
        self._sides = {open_interface(robot): "to_cloud", open_interface(cloud): "to_robot"}
        near, far = self._sides
        self._directions = {near: Direction("to_cloud", far), far: Direction("to_robot", near)}
        self._control = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._control.bind(control)
        self._control.listen(8)
        self._link = {"delay_ms": 0.0, "jitter_ms": 0.0, "loss_pct": 0.0, "rate_kbit": 0.0, "cut": None}
        self._recorded: Recorded | None = None
        self._under_way: list[tuple[float, int, Direction, bytes]] = []
        self._count = 0

    def run(self) -> None:
        """Carry frames until killed."""
        everything = [*self._sides, self._control]
        while True:
            wait = None
            if self._under_way:
                wait = max(0.0, self._under_way[0][0] - time.monotonic())
            # select, not epoll: its timeout is in microseconds, not in milliseconds.
            ready, _, _ = select.select(everything, [], [], wait)
            for each in ready:
                if each is self._control:
                    self._obey()
                else:
                    self._take(each)
            self._deliver()

    def _take(self, side: socket.socket) -> None:
        direction = self._directions[side]
        for _ in range(BURST):
            try:
                frame = side.recv(LARGEST_FRAME)
            except OSError:  # nothing more, or the interface is down for a moment
                return
            now = time.monotonic()
            if self._recorded is not None and self._recorded.over(now):
                self._recorded = None
            arrives = direction.arrival(now, len(frame), self._link, self._recorded)
            if arrives is None:
                direction.dropped += 1
            elif arrives <= now and not self._under_way:
                self._put(direction, frame)
            else:
                self._count += 1
                heapq.heappush(self._under_way, (arrives, self._count, direction, frame))

    def _deliver(self) -> None:
        while self._under_way and self._under_way[0][0] <= time.monotonic():
            _, _, direction, frame = heapq.heappop(self._under_way)
            self._put(direction, frame)

    def _put(self, direction: Direction, frame: bytes) -> None:
        try:
            direction.out.send(frame)
            direction.passed += 1
        except OSError:  # full, or the other end is just being removed
            direction.dropped += 1

    def _obey(self) -> None:
        talk, _ = self._control.accept()
        with talk:
            talk.settimeout(1)
            try:
                order = json.loads(talk.makefile().readline())
                if "recording" in order:
                    given = order["recording"]
                    begun = time.monotonic()
                    self._recorded = Recorded(given["ends"], given["round_trips"], given["stall"], begun)
                elif "set" in order:
                    self._recorded = None
                    self._link |= order["set"]
                counts = {each.name: [each.passed, each.dropped] for each in self._directions.values()}
                state = {"link": self._link, "playing": self._recorded is not None, "frames": counts}
                talk.sendall(json.dumps(state).encode() + b"\n")
            except (OSError, ValueError) as error:  # who asked is gone, or asked nonsense
                sys.stderr.write(f"order not understood: {error}" + "\n")


def open_interface(name: str) -> socket.socket:
    """A socket that sees all frames that come in at an interface, and none that go out."""
    opened = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, 0)
    opened.setsockopt(SOL_PACKET, PACKET_VNET_HDR, 1)  # carries unfinished checksums across
    opened.setsockopt(SOL_PACKET, PACKET_IGNORE_OUTGOING, 1)
    for option in (socket.SO_RCVBUF, socket.SO_SNDBUF):
        opened.setsockopt(socket.SOL_SOCKET, option, 4 << 20)
    opened.bind((name, ALL_PROTOCOLS))
    everything = struct.pack("iHH8s", socket.if_nametoindex(name), PACKET_MR_PROMISC, 0, b"")
    opened.setsockopt(SOL_PACKET, PACKET_ADD_MEMBERSHIP, everything)
    opened.setblocking(False)
    return opened


def main() -> None:
    """Run one wire."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--control", required=True, help="path of the socket over which it is steered")
    parser.add_argument("--robot", required=True, help="interface on the robot's side")
    parser.add_argument("--cloud", required=True, help="interface on the other side")
    parser.add_argument("--realtime", action="store_true", help="ask for real-time priority")
    chosen = parser.parse_args()
    process = Process(chosen.robot, chosen.cloud, chosen.control)
    if chosen.realtime:
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(REALTIME_PRIORITY))
        except PermissionError:
            sys.stderr.write("no right to real-time priority: other work on this machine adds to the delay" + "\n")
    gc.disable()  # nothing here makes cycles
    process.run()


if __name__ == "__main__":
    main()
