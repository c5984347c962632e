"""A wire between two network interfaces, as a process of its own: frames go through the emulated link.

`wire.Wire` steers it. What the link does to a frame is the model of `robot_offload_lab.wire`, as on one machine.
"""

from __future__ import annotations

import argparse
import dataclasses
import gc
import json
import os
import socket
import struct
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from robot_offload_lab.links.recorded import load_trace
from robot_offload_lab.wire.link import Direction, EmulatedLink
from robot_offload_lab.wire.loop import READ, Loop, steady_s
from robot_offload_lab.wire.model import LinkConditions, WireError
from robot_offload_lab.wire.options import LinkOptions
from robot_offload_lab.wire.schedule import Constant, Replay, Schedule

# Of linux/if_packet.h.
SOL_PACKET, PACKET_VNET_HDR, PACKET_IGNORE_OUTGOING = 263, 15, 23
PACKET_ADD_MEMBERSHIP, PACKET_MR_PROMISC = 1, 1
ALL_PROTOCOLS = 3
LARGEST_FRAME = 70000
BURST = 64  # frames from one side before the other side and the frames that are due get their turn
BUFFER_MS = 500.0  # of a link with a limited rate: frames that would wait longer are dropped
REALTIME_PRIORITY = 20
WAYS: Final[Mapping[Direction, str]] = {"up": "to_cloud", "down": "to_robot"}
CUTS: Final[Mapping[str | None, str | None]] = {"both": "both", "to_cloud": "up", "to_robot": "down", None: None}


@dataclasses.dataclass(frozen=True)
class WireSettings:
    """The settings of `Wire.set`, in its units."""

    delay_ms: float = 0.0
    jitter_ms: float = 0.0
    loss_pct: float = 0.0
    rate_kbit: float = 0.0
    cut: str | None = None

    def constant(self, *, recorded: bool = False) -> Constant:
        """Return both directions; without delay and jitter if a recording provides them."""
        if self.cut not in CUTS:
            raise WireError(f"cut must be both, to_cloud, to_robot or null, found {self.cut!r}")
        same = LinkConditions(
            delay_ms=0.0 if recorded else self.delay_ms,
            jitter_ms=0.0 if recorded else self.jitter_ms,
            loss=self.loss_pct / 100,
            rate_kbit_s=self.rate_kbit,
            queue_ms=BUFFER_MS if self.rate_kbit else 0.0,
        )
        up, down = (dataclasses.replace(same, cut=self.cut in ("both", WAYS[way])) for way in WAYS)
        return Constant(up, down)


class Steering:
    """What the link follows: settings, a recording, or a schedule that begins on command."""

    def __init__(self, seed: int) -> None:
        self.settings = WireSettings()
        self.link = EmulatedLink(Schedule((self.settings.constant(),)), seed)
        self._over_s: float | None = None
        self._followed = False

    def settle(self, now_s: float) -> None:
        """Return the link to the settings when a recording is over."""
        if self._over_s is not None and now_s >= self._over_s:
            self._follow(Schedule((self.settings.constant(),)))

    def obey(self, order: Mapping[str, Any], now_s: float) -> dict[str, Any]:
        """Carry out an order.

        Raises:
            WireError, TypeError: the order is not valid.
        """
        if "set" in order:
            self._set(dataclasses.replace(self.settings, **order["set"]), order["set"])
        elif "play" in order:
            trace = load_trace(Path(order["play"]))
            self._follow(Schedule((self.settings.constant(recorded=True), Replay(trace))))
            self.link.start(now_s)
            self._over_s = now_s + trace.duration_s
        elif "follow" in order:
            self._follow(LinkOptions.from_dict(order["follow"]).schedule())
            self._followed = True
        elif "start" in order:
            self.link.start(now_s)
        frames = {WAYS[way]: [each.datagrams - each.dropped, each.dropped] for way, each in self.link.counters.items()}
        return {
            "link": dataclasses.asdict(self.settings),
            "playing": self._over_s is not None,
            "started_s": self.link.started_s,
            "frames": frames,
        }

    def _set(self, settings: WireSettings, named: Mapping[str, Any]) -> None:
        """Put the given settings on top of the followed link, or else make them the link."""
        constant = settings.constant()
        if self._followed:
            both = {"delay_ms": constant.up.delay_ms, "jitter_ms": constant.up.jitter_ms, "loss": constant.up.loss}
            words = {"delay_ms": "delay_ms", "jitter_ms": "jitter_ms", "loss_pct": "loss"}
            cut = {"cut": CUTS[settings.cut]} if "cut" in named else {}
            self.link.override({words[name]: both[words[name]] for name in named if name in words} | cut)
        else:
            self._follow(Schedule((constant,)))
        self.settings = settings

    def _follow(self, schedule: Schedule) -> None:
        self.link.override({"delay_ms": None, "jitter_ms": None, "loss": None, "cut": None})
        self.link.follow(schedule)
        self._over_s, self._followed = None, False


class FrameRelay:
    """Both directions, the frames under way, and the socket over which the link is steered."""

    def __init__(self, robot: str, cloud: str, control: str) -> None:
        self._loop = Loop()
        self._steering = Steering(seed=int.from_bytes(os.urandom(4), "big"))
        near, far = open_interface(robot), open_interface(cloud)
        self._loop.watch(near, READ, lambda _: self._carry("up", near, far))
        self._loop.watch(far, READ, lambda _: self._carry("down", far, near))
        self._control = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._control.bind(control)
        self._control.listen(8)
        self._loop.watch(self._control, READ, lambda _: self._answer())

    def run(self) -> None:
        """Carry frames until killed."""
        while True:
            self._loop.run_once()

    def _carry(self, direction: Direction, source: socket.socket, target: socket.socket) -> None:
        for _ in range(BURST):
            try:
                frame = source.recv(LARGEST_FRAME)
            except OSError:  # nothing more, or the interface is down for a moment
                return
            now_s = steady_s()
            self._steering.settle(now_s)
            arrives_s = self._steering.link.datagram(direction, now_s, len(frame))
            if arrives_s is not None:
                self._loop.call_at(arrives_s, lambda frame=frame: self._put(direction, target, frame))  # type: ignore[misc]

    def _put(self, direction: Direction, target: socket.socket, frame: bytes) -> None:
        try:
            target.send(frame)
        except OSError:  # full, or the other end is just being removed
            self._steering.link.counters[direction].dropped += 1

    def _answer(self) -> None:
        talk, _ = self._control.accept()
        with talk:
            talk.settimeout(1)
            try:
                order = json.loads(talk.makefile().readline())
                talk.sendall(json.dumps(self._steering.obey(order, steady_s())).encode() + b"\n")
            except (OSError, ValueError, TypeError, WireError) as error:  # the sender is gone, or the order is invalid
                sys.stderr.write(f"order not understood: {error}" + "\n")


def open_interface(name: str) -> socket.socket:
    """Return a socket that receives all incoming frames of an interface, and no outgoing ones."""
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
    parser.add_argument("--control", required=True, help="path of the socket over which the link is steered")
    parser.add_argument("--robot", required=True, help="interface on the robot's side")
    parser.add_argument("--cloud", required=True, help="interface on the other side")
    parser.add_argument("--realtime", action="store_true", help="ask for real-time priority")
    chosen = parser.parse_args()
    process = FrameRelay(chosen.robot, chosen.cloud, chosen.control)
    if chosen.realtime:
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(REALTIME_PRIORITY))
        except PermissionError:
            sys.stderr.write("no right to real-time priority: other work on this machine adds to the delay" + "\n")
    gc.freeze()
    gc.disable()  # nothing here makes cycles
    process.run()


if __name__ == "__main__":
    main()
