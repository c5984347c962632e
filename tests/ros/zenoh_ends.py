"""Ends of Zenoh links on the loopback interface, with real certificates, for tests.

Run as a program, this file is an end in a process of its own, which can be killed.
"""

from __future__ import annotations

import datetime
import json
import os
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Any

from robot_offload_agent.link.port import Channel
from robot_offload_agent.link.zenoh import ZenohLink
from robot_offload_agent.link.zenoh_config import ZenohSettings
from robot_offload_agent.link.zenoh_log import WheelLog
from robot_offload_core.words.declared import Priority
from robot_offload_lab.run.certificates import CertificatePaths, make_certificates
from tests.ros.ports import HOST

CHANNELS = [
    Channel("beat", reliable=False, urgent=True), Channel("in/scan"), Channel("out/cmd", reliable=False),
    Channel("in/first", priority=Priority.HIGH), Channel("in/last", priority=Priority.LOW),
]  # fmt: skip
PATIENCE_S = 60.0
ROOT = Path(__file__).parents[2]


class End:
    """One end of a link and what it has received."""

    def __init__(self, settings: ZenohSettings, wheel: WheelLog | None = None) -> None:
        self.received: list[tuple[str, bytes, bytes]] = []
        self.room: list[str] = []
        self.link = ZenohLink(
            settings, CHANNELS, lambda *message: self.received.append(message), wheel, self.room.append
        )


class Ends:
    """Makes ends, in this process and in others, and ends them all."""

    def __init__(self) -> None:
        self.opened: list[End] = []
        self.started: list[subprocess.Popen[str]] = []

    def open(self, settings: ZenohSettings, wheel: WheelLog | None = None) -> End:
        self.opened.append(End(settings, wheel))
        self.opened[-1].link.start()
        return self.opened[-1]

    def process(self, settings: ZenohSettings, *, fork: bool = False) -> subprocess.Popen[str]:
        """An end that sends back what it receives."""
        order = json.dumps({"fork": fork, "settings": settings.__dict__})
        command = [sys.executable, "-m", "tests.ros.zenoh_ends", order]
        process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
        self.started.append(process)
        assert process.stdout is not None
        assert process.stdout.readline() == "started\n"
        return process

    def close(self) -> None:
        for end in self.opened:
            end.link.close()
        for process in self.started:
            process.kill()
            process.wait()
            assert process.stdout is not None
            process.stdout.close()


def make_settings(paths: CertificatePaths, side: str, port: int, **changes: Any) -> ZenohSettings:
    own = paths.robot if side == "robot" else paths.cloud
    values: dict[str, Any] = {
        "side": side,
        "session": "data",
        "uid": "wheelchair-7",
        "endpoints": (f"quic/{HOST}:{port}",),
        "ca": str(own.ca),
        "certificate": str(own.certificate),
        "private_key": str(own.private_key),
        "peer_name": "cloud" if side == "robot" else "wheelchair-7",
        "lease_ms": 1000,
    }
    return ZenohSettings(**{**values, **changes})


def new_certificates(directory: Path, host: str = HOST, clients: Sequence[str] = ()) -> CertificatePaths:
    now = datetime.datetime.now(datetime.UTC)
    return make_certificates(directory, robot="wheelchair-7", host_names=[host], now=now, clients=clients)


def eventually(condition: Callable[[], Any], what: str = "") -> None:
    end_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end_s, f"not within {PATIENCE_S} s: {what}"
        time.sleep(0.02)


def all_in(received: Collection[object], sent: Collection[object]) -> bool:
    return all(message in received for message in sent)


def connected(*ends: End) -> None:
    eventually(lambda: all(e.link.status().connected for e in ends), str([e.link.status() for e in ends]))


def crosses(sender: End, receiver: End, channel: str = "in/scan") -> None:
    """Until one of repeated messages has arrived: the first ones may come before the subscription is known."""
    text = os.urandom(8)

    def arrived() -> bool:
        sender.link.send(channel, b"header", text)
        return (channel, b"header", text) in receiver.received

    eventually(arrived, f"{channel} from {sender.link.settings.side}")


def never_connects(robot: End, cloud: End | None, duration_s: float = 2.5) -> None:
    end_s = time.monotonic() + duration_s
    while time.monotonic() < end_s:
        assert not robot.link.status().connected
        assert cloud is None or not cloud.link.status().connected
        time.sleep(0.05)


def echoes_return(robot: End) -> None:
    """The other process sends everything back."""
    text = os.urandom(8)

    def arrived() -> bool:
        robot.link.send("in/scan", b"h", text)
        return ("in/scan", b"h", text) in robot.received

    eventually(arrived, "echo")


def blocked_udp(port: int) -> socket.socket:
    """A port that swallows everything, like a firewall."""
    hole = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    hole.bind((HOST, port))
    return hole


class Gate:
    """A UDP port before another one that swallows everything while it is shut, like a firewall."""

    def __init__(self, port: int, behind: int) -> None:
        self.is_open = False
        self.front = blocked_udp(port)
        self.behind = (HOST, behind)
        self.dialled: dict[tuple[str, int], socket.socket] = {}
        self.ended = threading.Event()
        self.thread = threading.Thread(target=self.run)
        self.thread.start()

    def run(self) -> None:
        while not self.ended.is_set():
            for ready in select.select([self.front, *self.dialled.values()], [], [], 0.05)[0]:
                data, sender = ready.recvfrom(65536)
                if not self.is_open:
                    continue
                if ready is self.front:
                    if sender not in self.dialled:
                        self.dialled[sender] = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
                    self.dialled[sender].sendto(data, self.behind)
                else:
                    client = next(address for address, s in self.dialled.items() if s is ready)
                    self.front.sendto(data, client)

    def close(self) -> None:
        self.ended.set()
        self.thread.join()
        for each in (self.front, *self.dialled.values()):
            each.close()


def run_other_side(order: dict[str, Any]) -> None:
    """Starts a link that sends back what it receives, until SIGTERM."""
    settings: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in order["settings"].items()}
    if order["fork"] and (child := os.fork()):
        signal.signal(signal.SIGTERM, lambda *_: os.kill(child, signal.SIGKILL))
        os.waitpid(child, 0)
        return
    parent = os.getppid()

    def send_back(channel: str, header: bytes, payload: bytes) -> None:
        link.send(channel, header, payload)

    link = ZenohLink(ZenohSettings(**settings), CHANNELS, send_back)
    stop = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: stop.set())
    link.start()
    sys.stdout.write("started\n")
    sys.stdout.flush()
    while not stop.wait(0.2) and os.getppid() == parent:
        pass
    link.close()


if __name__ == "__main__":
    run_other_side(json.loads(sys.argv[1]))
