"""`robot-offload console`: the page in the browser, for a cluster or a recording."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import sys
import webbrowser
from collections.abc import Callable, Iterator
from importlib.metadata import entry_points
from pathlib import Path
from typing import Annotated

import typer

from robot_offload.cli.app import example_text
from robot_offload.cli.cluster import Context, Kubeconfig, Namespace, Target
from robot_offload.console.cluster import ClusterSource
from robot_offload.console.other_rules import GROUP
from robot_offload.console.server import serve
from robot_offload.console.source import Source
from robot_offload.errors import InputError

EXAMPLES = (
    "kubectl offload console",
    "kubectl offload console --all-namespaces --port 8090 --no-open",
    "robot-offload console out/demo",
)


def add_to(app: typer.Typer) -> None:
    """Add the command to `app`."""
    app.command("console", epilog=example_text(EXAMPLES))(console)


def console(
    recording: Annotated[
        Path | None, typer.Argument(metavar="RECORDING", help="Folder of a demo's report, or its recording.jsonl.")
    ] = None,
    *,
    namespace: Namespace = None,
    every: Annotated[bool, typer.Option("--all-namespaces", "-A", help="Show the robots of all namespaces.")] = False,
    port: Annotated[
        int, typer.Option(metavar="PORT", min=0, max=65535, help="Port on 127.0.0.1. Default: a free one.")
    ] = 0,
    browser: Annotated[
        bool, typer.Option("--open/--no-open", help="Open the page in the browser. Default: on a terminal.")
    ] = sys.stdout.isatty(),
    context: Context = None,
    kubeconfig: Kubeconfig = None,
) -> None:
    """Show all robots in the browser: which side acts and why, live and scrolled back; with RECORDING a finished run.

    The page is served on this machine alone, at an address with a secret in it. It reads and writes with the rights of
    your kubeconfig and with no others. Ctrl-C ends it.
    """

    def ready(address: str) -> None:
        typer.echo(f"Console: {address}  (Ctrl-C ends it)")
        sys.stdout.flush()
        if browser:
            webbrowser.open(address)

    if recording is not None:
        asyncio.run(_until_stopped(_recorded(recording), port, ready))
        return
    target = Target(kubeconfig, context, namespace)
    place = None if every else target.namespace

    async def work() -> None:
        async with target.api() as api:
            title = f"namespace {place}" if place else "all namespaces"
            await _until_stopped(ClusterSource(api, place, title), port, ready)

    asyncio.run(work())


async def _until_stopped(source: Source, port: int, ready: Callable[[str], None]) -> None:
    stop = asyncio.Event()
    with _signals(stop):
        await serve(source, port, ready, stop)


@contextlib.contextmanager
def _signals(stop: asyncio.Event) -> Iterator[None]:
    loop = asyncio.get_running_loop()
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    for number in numbers:
        loop.add_signal_handler(number, stop.set)
    try:
        yield
    finally:
        for number in numbers:
            loop.remove_signal_handler(number)


def _recorded(path: Path) -> Source:
    """Return a recording as a source; the lab reads it.

    Raises:
        InputError: the lab is not installed, or there is no recording.
    """
    for found in entry_points(group=GROUP, name="recording"):
        source: Source = found.load()(path)
        return source
    raise InputError("robot-offload console RECORDING is part of the lab: pip install robot-offload-lab")
