"""Certificates on disk, and both ends of a tunnel in one event loop."""

from __future__ import annotations

import asyncio
import datetime
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from robot_offload.render.pki import build_certificates
from robot_offload_agent.tunnel.configuration import Address, TunnelConfiguration
from robot_offload_agent.tunnel.ends import Tunnel
from robot_offload_core.fence.token import Site
from robot_offload_lab.run.free import free_ports

PATIENCE_S = 60.0
"""For what must happen, on however busy a machine."""


@dataclass(frozen=True)
class Rig:
    """Where everybody listens: the router on the robot's side of the tunnel, the tunnel in the cloud, its router."""

    near: int
    door: int
    router: int
    folder: Path

    def robot(
        self, certificates: str = "robot", host: str = "127.0.0.1", *, verify_name: bool = True
    ) -> TunnelConfiguration:
        folder = self.folder / certificates
        return TunnelConfiguration(
            Site.ROBOT, Address("127.0.0.1", self.near), (Address(host, self.door),),
            str(folder / "ca.pem"), str(folder / "own.pem"), str(folder / "own.key"), verify_name=verify_name,
        )  # fmt: skip

    def cloud(self) -> TunnelConfiguration:
        folder = self.folder / "cloud"
        return TunnelConfiguration(
            Site.CLOUD, Address("127.0.0.1", self.door), (Address("127.0.0.1", self.router),),
            str(folder / "ca.pem"), str(folder / "own.pem"), str(folder / "own.key"),
        )  # fmt: skip


def certified(folder: Path) -> Rig:
    """Free ports, and the certificates of a robot, its cloud and a thief with authorities of his own."""
    now = datetime.datetime.now(datetime.UTC)
    good = build_certificates(robot="r1", host_names=["127.0.0.1"], now=now)
    other = build_certificates(robot="r2", host_names=["127.0.0.1"], now=now)
    for name, ca, own in (
        ("robot", good.server_ca, good.robot),
        ("cloud", good.client_ca, good.cloud),
        ("foreign", good.server_ca, other.robot),
        ("misled", other.server_ca, good.robot),
    ):
        (folder / name).mkdir()
        (folder / name / "ca.pem").write_bytes(ca.certificate)
        (folder / name / "own.pem").write_bytes(own.certificate)
        (folder / name / "own.key").write_bytes(own.private_key)
    (near, door), (router, _) = free_ports()
    return Rig(near, door, router, folder)


def listens(port: int) -> bool:
    """Whether somebody listens on a port of the loopback interface; whoever asked with a connection would be served."""
    lines = Path("/proc/net/tcp").read_text().splitlines()[1:]
    return any(words[1] == f"0100007F:{port:04X}" and words[3] == "0A" for words in map(str.split, lines))


async def settled() -> None:
    """Gives the loop its turns, so that both ends hear of closed connections."""
    for _ in range(10):
        await asyncio.sleep(0.01)


@asynccontextmanager
async def running(configuration: TunnelConfiguration) -> AsyncIterator[None]:
    """One end, listening."""
    task = asyncio.create_task(Tunnel(configuration).run())
    try:
        async with asyncio.timeout(PATIENCE_S):
            while not listens(configuration.listen.port):
                await asyncio.sleep(0.01)
        yield
    finally:
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task
        await settled()


class Router:
    """Stands for the router in the cloud: answers each message with the same in capitals."""

    def __init__(self, port: int) -> None:
        self.port = port
        self.connections = 0

    async def __aenter__(self) -> Router:
        self._server = await asyncio.start_server(self._answer, "127.0.0.1", self.port)
        return self

    async def __aexit__(self, *_: object) -> None:
        self._server.close()

    async def _answer(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.connections += 1
        try:
            with suppress(OSError):
                while data := await reader.read(65536):
                    writer.write(data.upper())
        finally:
            writer.close()


async def answered(rig: Rig, text: bytes = b"hello") -> bytes:
    """What comes back for a message of the router on the robot, which dials again as routers do; empty: never."""
    with suppress(TimeoutError):
        async with asyncio.timeout(PATIENCE_S):
            while not (found := await ask(rig, text, PATIENCE_S)):
                await asyncio.sleep(0.05)
            return found
    return b""


async def ask(rig: Rig, text: bytes = b"hello", within_s: float = 1.0) -> bytes:
    """What comes back for one message of the router on the robot; empty: nothing."""
    reader, writer = await asyncio.open_connection("127.0.0.1", rig.near)
    try:
        writer.write(text)
        with suppress(OSError, asyncio.TimeoutError, asyncio.IncompleteReadError):
            return await asyncio.wait_for(reader.readexactly(len(text)), within_s)
        return b""
    finally:
        writer.close()
