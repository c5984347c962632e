"""Ends for the tests of the emulated link: echo servers, clients, and links with one port."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from robot_offload_lab.run.free import free_ports
from robot_offload_lab.wire.emulated import EmulatedWire, Forward, LinkOptions, WireConfig

HOST = "127.0.0.1"
PATIENCE_S = 60
"""For what must happen, on however busy a machine."""


@contextlib.contextmanager
def udp_echo(port: int = 0) -> Iterator[int]:
    """Answers every datagram with itself."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind((HOST, port))
        sock.settimeout(0.05)
        stopping = threading.Event()

        def serve() -> None:
            while not stopping.is_set():
                with contextlib.suppress(TimeoutError):
                    data, sender = sock.recvfrom(65535)
                    sock.sendto(data, sender)

        thread = threading.Thread(target=serve)
        thread.start()
        try:
            yield sock.getsockname()[1]
        finally:
            stopping.set()
            thread.join()


@contextlib.contextmanager
def tcp_listener() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as sock:
        sock.bind((HOST, 0))
        sock.listen()
        sock.settimeout(PATIENCE_S)
        yield sock


def accept(listener: socket.socket) -> socket.socket:
    connection, _ = listener.accept()
    connection.settimeout(PATIENCE_S)
    return connection


def free_port() -> int:
    """A port that nobody has with UDP or TCP, and that the kernel gives to nobody by chance."""
    return free_ports()[0][0]


def wire(protocol: Any, target: int, *, log: Path | None = None, seed: int = 1, **link: Any) -> EmulatedWire:
    forward = Forward("port", protocol, f"{HOST}:0", f"{HOST}:{target}")
    return EmulatedWire(WireConfig((forward,), LinkOptions(**link), seed=seed, log=str(log) if log else ""))


def udp_client(emulated: EmulatedWire) -> socket.socket:
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.connect((HOST, emulated.port("port")))
    sock.settimeout(PATIENCE_S)
    return sock


def tcp_client(emulated: EmulatedWire) -> socket.socket:
    return socket.create_connection((HOST, emulated.port("port")), timeout=PATIENCE_S)


@contextlib.contextmanager
def stream(**link: Any) -> Iterator[tuple[EmulatedWire, socket.socket, socket.socket]]:
    """A link and both ends of one connection through it: (wire, client, server)."""
    with tcp_listener() as listener, wire("tcp", listener.getsockname()[1], **link) as emulated:
        with tcp_client(emulated) as client, accept(listener) as server:
            yield emulated, client, server
        assert eventually(lambda: emulated.status()["clients"] == {"port": 0}), "closed connections are forgotten"


def received(sock: socket.socket, size: int) -> bytes:
    data = b""
    while len(data) < size and (chunk := sock.recv(size - len(data))):
        data += chunk
    return data


def arrives_within(sock: socket.socket, seconds: float) -> bytes | None:
    sock.settimeout(seconds)
    try:
        return sock.recv(65535)
    except TimeoutError:
        return None


def eventually(condition: Callable[[], bool], seconds: float = PATIENCE_S) -> bool:
    deadline_s = time.monotonic() + seconds
    while time.monotonic() < deadline_s:
        if condition():
            return True
        time.sleep(0.02)
    return False


def ended(pid: int) -> bool:
    """Whether a process has ended; on a machine whose first process collects no strangers, something stays of it."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except OSError:
        return True
