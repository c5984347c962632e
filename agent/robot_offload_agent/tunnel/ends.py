"""Both ends of the tunnel: who waits, who dials, and when a connection is given up.

TCP alone waits longer with each try, so a robot back in its network would be silent for seconds (for minutes after a
long cut). So a connection whose bytes stay unacknowledged for a second is dropped, and a new one is dialled twice a
second until the cloud answers.
"""

from __future__ import annotations

import asyncio
import logging
import socket
import ssl
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from robot_offload_agent.errors import ConfigurationError
from robot_offload_agent.runtime.clock import now_s
from robot_offload_agent.tunnel.configuration import Address, TunnelConfiguration
from robot_offload_agent.tunnel.names import Names
from robot_offload_core.fence.token import Site

log = logging.getLogger(__name__)

UNACKNOWLEDGED_MS = 1000
"""A connection is dead after this; above any pause from which a link recovers sooner than a new connection takes."""
SILENT_S = 6.0
"""Limit without a byte from the router beside this end; a living one announces itself every second."""
FAR_SILENT_S = 1.5
"""Limit without a byte from the far end. A proxy on the way acknowledges what the link behind it no longer carries."""
ANSWER_S = 0.6
"""Limit for the cloud's answer to a dialled connection: longer than any usable round trip, shorter than the 1 s after
which TCP itself tries again."""
PAUSE_S = 0.1
HANDSHAKE_S = 5.0
"""Python's own default is a minute, in which a stranger could hold thousands of connections."""
SHORT_LIFE_S = 2.0
LONGEST_PAUSE_S = 1.0
ROUTER_S = 10.0
_CHUNK = 1 << 18


@dataclass(eq=False)
class Stream:
    """A connection as asyncio gives it: incoming and outgoing bytes."""

    reader: asyncio.StreamReader
    writer: asyncio.StreamWriter

    def abort(self) -> None:
        """Drop the connection at once, including unsent bytes."""
        self.writer.transport.abort()


def context(configuration: TunnelConfiguration) -> ssl.SSLContext:
    """Return a context with this end's certificate and its trusted authority: TLS 1.3, certificates on both sides.

    Raises:
        ConfigurationError: a file is missing or has the wrong content.
    """
    robot = configuration.side is Site.ROBOT
    result = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT if robot else ssl.PROTOCOL_TLS_SERVER)
    result.minimum_version = ssl.TLSVersion.TLSv1_3
    result.check_hostname = robot and configuration.verify_name
    result.verify_mode = ssl.CERT_REQUIRED
    try:
        result.load_verify_locations(configuration.ca)
        result.load_cert_chain(configuration.certificate, configuration.private_key)
    except (OSError, ValueError) as error:
        files = f"{configuration.ca}, {configuration.certificate}, {configuration.private_key}"
        raise ConfigurationError(f"certificates ({files}): {error}; write the bundle again") from error
    return result


def newest(configuration: TunnelConfiguration) -> TunnelConfiguration:
    """Return the configuration with the pair that the agent has renewed; unchanged while there is none."""
    certificate, key = (Path(configuration.own) / name for name in ("robot.pem", "robot.key"))
    if not configuration.own or not (certificate.exists() and key.exists()):
        return configuration
    return replace(configuration, certificate=str(certificate), private_key=str(key))


class Tunnel:
    """One end. It carries one connection at a time, the newest: an older one is left from a cut."""

    def __init__(self, configuration: TunnelConfiguration) -> None:
        """Open nothing yet.

        Raises:
            ConfigurationError: the certificates cannot be used.
        """
        self._configuration = configuration
        self._robot = configuration.side is Site.ROBOT
        self._context = context(configuration)
        self._names = Names()
        self._addresses = list(configuration.connect)
        self._carrying: asyncio.Task[None] | None = None
        self._failed = 0

    async def run(self) -> None:
        """Listen until it is cancelled.

        Raises:
            ConfigurationError: the address to listen on is not available.
        """
        listen = self._configuration.listen
        secured = None if self._robot else self._context
        limit_s = None if self._robot else HANDSHAKE_S
        try:
            server = await asyncio.start_server(
                self._accept, listen.host, listen.port, ssl=secured, ssl_handshake_timeout=limit_s
            )
        except OSError as error:
            raise ConfigurationError(f"listen: {listen}: {error}") from error
        log.info("Listening address=%s", listen)
        try:
            await asyncio.get_running_loop().create_future()
        finally:
            server.close()
            if self._carrying is not None:
                self._carrying.cancel()

    async def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if not self._robot and not self._is_the_robot(writer):
            writer.transport.abort()
            return
        before, self._carrying = self._carrying, asyncio.current_task()
        if before is not None:
            before.cancel()
        accepted = Stream(reader, writer)
        tune(writer)
        try:
            await self._carry(accepted)
        except asyncio.CancelledError:
            log.info("Dropped a connection for a newer one")
        except (OSError, asyncio.TimeoutError, ssl.SSLError) as error:
            log.warning("Lost the connection reason=%s", error or type(error).__name__)
        finally:
            accepted.abort()

    def _is_the_robot(self, writer: asyncio.StreamWriter) -> bool:
        """Return whether a certificate signed by the authority is this robot's; an authority may serve many."""
        wanted, found = self._configuration.peer_name, common_name(writer.get_extra_info("peercert"))
        if wanted in ("", found):
            return True
        log.warning("Refused a robot of another name name=%s wanted=%s", found, wanted)
        return False

    async def _carry(self, accepted: Stream) -> None:
        far = await (self._dial() if self._robot else self._router())
        started_s = now_s()
        log.info("Connected to=%s", far.writer.get_extra_info("peername"))
        try:
            log.info("Disconnected reason=%s", await join(accepted, far, *self._limits_s()))
        finally:
            far.abort()
            # A refused certificate shows only now; a cloud that refuses it is dialled less and less often.
            self._failed = self._failed + 1 if now_s() - started_s < SHORT_LIFE_S else 0

    def _limits_s(self) -> tuple[float, float]:
        """Return how long the accepted and the dialled connection may be silent."""
        return (SILENT_S, FAR_SILENT_S) if self._robot else (FAR_SILENT_S, SILENT_S)

    async def _dial(self) -> Stream:
        """Return a connection to the cloud; wait for it without limit."""
        await asyncio.sleep(min(PAUSE_S * 2**self._failed, LONGEST_PAUSE_S) if self._failed else 0)
        while True:
            for address in tuple(self._addresses):
                for host in await self._names.hosts(address):
                    with suppress(OSError, asyncio.TimeoutError, ssl.SSLError):
                        stream = await self._dial_one(address, host)
                        # The address that worked is tried first next time: one of several cluster nodes may be gone for
                        # long.
                        self._addresses.sort(key=lambda one: one != address)
                        return stream
            await asyncio.sleep(PAUSE_S)

    async def _dial_one(self, address: Address, host: str) -> Stream:
        loop = asyncio.get_running_loop()
        connection = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_STREAM)
        try:
            connection.setblocking(False)
            await asyncio.wait_for(loop.sock_connect(connection, (host, address.port)), ANSWER_S)
            opening = asyncio.open_connection(
                sock=connection, ssl=self._proof(), server_hostname=address.host, ssl_handshake_timeout=HANDSHAKE_S
            )
            # A cut in the middle of the handshake must not cost its whole time limit.
            reader, writer = await asyncio.wait_for(opening, 3 * ANSWER_S)
        except BaseException as error:
            connection.close()
            if isinstance(error, ssl.SSLError):
                log.warning("The cloud is not the expected one address=%s reason=%s", address, error)
                self._failed += 1
                await asyncio.sleep(LONGEST_PAUSE_S)
            raise
        tune(writer)
        return Stream(reader, writer)

    def _proof(self) -> ssl.SSLContext:
        """Return the context to dial with: the robot's newest pair; after failures every other time the bundle's."""
        chosen = newest(self._configuration)
        if chosen is self._configuration or self._failed % 2:
            return self._context
        try:
            return context(chosen)
        except ConfigurationError as error:
            log.warning("Dialling with the bundle's certificate: %s", error)
            return self._context

    async def _router(self) -> Stream:
        """Return a connection to the router beside this end, which may be just starting."""
        address, until_s = self._configuration.connect[0], now_s() + ROUTER_S
        while True:
            try:
                stream = Stream(*await asyncio.open_connection(address.host, address.port))
            except OSError:
                if now_s() > until_s:
                    raise
                await asyncio.sleep(PAUSE_S)
            else:
                tune(stream.writer)
                return stream


def common_name(certificate: Mapping[str, Any] | None) -> str:
    """Return the common name in a certificate as the module ssl describes it; empty: it has none."""
    names = [value for part in (certificate or {}).get("subject", ()) for key, value in part if key == "commonName"]
    return str(names[-1]) if names else ""


async def join(one: Stream, other: Stream, one_s: float, other_s: float) -> str:
    """Carry bytes both ways until one of the two connections ends, and return why.

    Args:
        one: the accepted connection.
        other: the dialled connection.
        one_s: how long the first may be silent.
        other_s: how long the second may be silent.
    """
    heard = Heard((one_s, other_s))
    tasks = [
        asyncio.create_task(_pump(one, other, heard, 0), name="accepted"),
        asyncio.create_task(_pump(other, one, heard, 1), name="dialled"),
        asyncio.create_task(heard.until_silent(), name="silence"),
    ]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        ended = done.pop()
        return f"{ended.get_name()}: {ended.exception() or 'closed'}"
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


class Heard:
    """Time of the last bytes from each of two connections, and how long each may be silent."""

    def __init__(self, limits_s: tuple[float, float]) -> None:
        self._limits_s = limits_s
        self._last_s = [now_s(), now_s()]

    def now(self, which: int) -> None:
        """Record that bytes arrived."""
        self._last_s[which] = now_s()

    async def until_silent(self) -> None:
        """Return when one of them has been silent for too long."""
        while all(now_s() - last_s < limit_s for last_s, limit_s in zip(self._last_s, self._limits_s, strict=True)):
            await asyncio.sleep(min(self._limits_s) / 8)


async def _pump(source: Stream, target: Stream, heard: Heard, which: int) -> None:
    while data := await source.reader.read(_CHUNK):
        heard.now(which)
        target.writer.write(data)
        await target.writer.drain()


def tune(writer: asyncio.StreamWriter) -> None:
    """Send small messages at once, and give a connection up when its bytes are not acknowledged."""
    connection = writer.get_extra_info("socket")
    with suppress(OSError):  # closed meanwhile
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, UNACKNOWLEDGED_MS)
