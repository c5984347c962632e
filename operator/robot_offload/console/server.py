"""The web server of a console: on the loopback alone, behind the guard, on a port of its own."""

from __future__ import annotations

import asyncio
import contextlib
import secrets
import socket
from collections.abc import Callable
from typing import Final

import uvicorn
from fastapi import FastAPI
from nicegui import app as pages
from nicegui import ui

from robot_offload.console import frame
from robot_offload.console.fleet_page import FleetPage
from robot_offload.console.guard import Guard
from robot_offload.console.live import Key
from robot_offload.console.robot_page import RobotPage
from robot_offload.console.session import Session
from robot_offload.console.source import Source
from robot_offload.errors import InputError

HOST: Final = "127.0.0.1"
ICON: Final = "🤖"
RECONNECT_S: Final = 10.0
"""A tab that slept for less than this comes back to the same page."""


def listener(port: int) -> socket.socket:
    """Open a socket on the loopback; port 0: a free one.

    Raises:
        InputError: another program listens there.
    """
    found = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        found.bind((HOST, port))
    except OSError as error:
        found.close()
        raise InputError(f"--port: {port} cannot be used: {error.strerror}; leave it out for a free one") from error
    return found


def address(port: int, token: str) -> str:
    """Return the address that a person opens."""
    return f"http://{HOST}:{port}/?token={token}"


class _Server(uvicorn.Server):
    """A server that leaves signals to its caller."""

    def capture_signals(self) -> contextlib.AbstractContextManager[None]:  # type: ignore[override]
        """Capture nothing."""
        return contextlib.nullcontext()


async def serve(source: Source, port: int, ready: Callable[[str], None], stop: asyncio.Event) -> None:
    """Serve the pages until `stop` is set.

    Args:
        source: of the pages.
        port: 0: a free one.
        ready: called with the address once it answers.
        stop: ends the server.

    Raises:
        InputError: the port is taken.
    """
    listening = listener(port)
    token, port = secrets.token_urlsafe(24), listening.getsockname()[1]
    session = Session(source)
    outer = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    _pages(session)
    ui.run_with(
        outer,
        title="Robot Offload",
        favicon=ICON,
        reconnect_timeout=RECONNECT_S,
        show_welcome_message=False,
        tailwind=True,
        gzip_middleware_factory=None,
        binding_refresh_interval=None,
    )
    outer.add_middleware(Guard, token=token, port=port)
    config = uvicorn.Config(
        outer,
        log_level="warning",
        access_log=False,
        ws="websockets-sansio",
        timeout_graceful_shutdown=1,
        lifespan="on",
        ws_per_message_deflate=False,  # on the loopback compression costs more than it saves
    )
    server = _Server(config)
    running = asyncio.create_task(server.serve(sockets=[listening]))
    try:
        while not server.started and not running.done():
            await asyncio.sleep(0.02)
        if not running.done():
            ready(address(port, token))
        ending = asyncio.create_task(stop.wait())
        await asyncio.wait({running, ending}, return_when=asyncio.FIRST_COMPLETED)
        ending.cancel()
        server.should_exit = True
        await running
    finally:
        listening.close()


def _pages(session: Session) -> None:
    """Register the pages by address."""
    pages.on_startup(session.start)
    pages.on_shutdown(session.stop)
    frame.serve_nothing_else()

    @ui.page("/")
    def fleet() -> None:
        FleetPage(session)

    @ui.page("/robot/{namespace}/{name}")
    def robot(namespace: str, name: str) -> None:
        RobotPage(session, Key("" if namespace == "-" else namespace, name))
