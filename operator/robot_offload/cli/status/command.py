"""`robot-offload status`: which side acts for every robot, why, and how the link is."""

from __future__ import annotations

import asyncio
import datetime
import json
from typing import Annotated, Final

import typer
from rich.console import Console, RenderableType
from rich.live import Live as LivePicture

from robot_offload.cli.app import example_text
from robot_offload.cli.cluster import HURRY, Context, Kubeconfig, Live, Namespace, Target, find, find_all, live
from robot_offload.cli.status import show
from robot_offload.insight.observed import Observed, observe
from robot_offload.kube.port import KubeApi

EXAMPLES = (
    "robot-offload status",
    "robot-offload status wheelchair-7 --watch",
    "kubectl offload status --all-namespaces",
    "kubectl offload status --json | jq -r '.[] | select(.ready | not) | .name'",
)
WATCH_EVERY_S: Final = 2.0
PLAIN_COLUMNS: Final = 200
AT_ONCE: Final = 16
"""How many agents are asked concurrently."""


def add_to(app: typer.Typer) -> None:
    """Add the command to `app`."""
    app.command("status", epilog=example_text(EXAMPLES))(status)


def status(
    name: Annotated[str | None, typer.Argument(metavar="[NAME]", help="Default: all of the namespace.")] = None,
    *,
    all_namespaces: Annotated[bool, typer.Option("--all-namespaces", "-A", help="Of all namespaces.")] = False,
    watch: Annotated[bool, typer.Option("--watch", "-w", help="Show it again and again, until Ctrl-C.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print it as JSON, one list.")] = False,
    namespace: Namespace = None,
    context: Context = None,
    kubeconfig: Kubeconfig = None,
) -> None:
    """Show which side acts, why, the latency, and how robot and nodes are.

    With a name: everything about that one. Live numbers come from the cloud agent through the API server; without
    them the status of the resource is shown. Ends with 0, with 1 when the cluster does not answer.
    """
    target = Target(kubeconfig, context, namespace)
    place = None if all_namespaces and name is None else target.namespace
    console = Console(highlight=False)
    if not watch:
        found = asyncio.run(_once(target, place, name))
        if as_json:
            typer.echo(json.dumps([show.plain(*each) for each in found], indent=2))
            return
        if console.is_terminal:
            console.print(_picture(found, place, name))
        else:
            typer.echo(_text(found, place, name))
        return
    try:
        asyncio.run(_watch(target, place, name, console, as_json=as_json))
    except KeyboardInterrupt:
        return


Found = list[tuple[Observed, Live]]


async def _once(target: Target, place: str | None, name: str | None) -> Found:
    async with target.api() as api, target.api(HURRY) as hurry:
        return await _look(api, hurry, place, name)


async def _look(api: KubeApi, hurry: KubeApi, place: str | None, name: str | None) -> Found:
    if name is not None and place is not None:
        offloads = [observe(await find(api, place, name))]
    else:
        offloads = [observe(each) for each in await find_all(api, place)]
    gate = asyncio.Semaphore(AT_ONCE)

    async def ask(offload: Observed) -> Live:
        async with gate:
            return await live(hurry, offload.namespace, offload.name)

    return list(zip(offloads, await asyncio.gather(*map(ask, offloads)), strict=True))


async def _watch(target: Target, place: str | None, name: str | None, console: Console, *, as_json: bool) -> None:
    """Look again every two seconds. Without a terminal, print only changes."""
    last = ""
    async with target.api() as api, target.api(HURRY) as hurry:
        with LivePicture(console=console, auto_refresh=False, transient=False) as picture:
            while True:
                found = await _look(api, hurry, place, name)
                if as_json or not console.is_terminal:
                    text = json.dumps([show.plain(*each) for each in found]) if as_json else _text(found, place, name)
                    if text != last:
                        typer.echo(text)
                    last = text
                else:
                    picture.update(_picture(found, place, name), refresh=True)
                await asyncio.sleep(WATCH_EVERY_S)


def _picture(found: Found, place: str | None, name: str | None) -> RenderableType:
    now = datetime.datetime.now(datetime.UTC)
    if name is not None:
        return show.details(*found[0], now)
    if not found:
        where = f"in namespace {place}" if place else "in any namespace"
        return f"There is no RobotOffload {where}. Create one: kubectl apply -f manifests/samples/talker.yaml"
    offloads, lives = [each for each, _ in found], [each for _, each in found]
    return show.table(offloads, lives, now, namespaces=place is None)


def _text(found: Found, place: str | None, name: str | None) -> str:
    console = Console(width=PLAIN_COLUMNS, color_system=None, highlight=False)
    with console.capture() as captured:
        console.print(_picture(found, place, name))
    return "\n".join(line.rstrip() for line in captured.get().splitlines())
