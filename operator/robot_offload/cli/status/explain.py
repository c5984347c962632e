"""`robot-offload explain`: why a RobotOffload is not Ready, and the next step."""

from __future__ import annotations

import dataclasses
import datetime
import json
from typing import Annotated, Any

import typer

from robot_offload.cli.app import example_text
from robot_offload.cli.cluster import HURRY, Context, Kubeconfig, Name, Namespace, Target, find, live
from robot_offload.insight.explanation import Explanation
from robot_offload.insight.explanation import explain as explanation_of
from robot_offload.insight.observed import observe
from robot_offload.kube.errors import KubeError
from robot_offload.kube.kinds import EVENT
from robot_offload.kube.port import KubeApi

EXAMPLES = (
    "robot-offload explain wheelchair-7",
    "kubectl offload explain wheelchair-7 -n ward --json | jq -r '.problems[0].step'",
)


def add_to(app: typer.Typer) -> None:
    """Add the command to `app`."""
    app.command("explain", epilog=example_text(EXAMPLES))(explain)


def explain(
    name: Name,
    *,
    as_json: Annotated[bool, typer.Option("--json", help="Print it as JSON.")] = False,
    namespace: Namespace = None,
    context: Context = None,
    kubeconfig: Kubeconfig = None,
) -> None:
    """Show why a RobotOffload is not Ready, and the next step for each problem.

    Ends with 0 when it is Ready, with 1 when it is not.
    """
    target = Target(kubeconfig, context, namespace)
    place = target.namespace

    async def work(api: KubeApi) -> Explanation:
        manifest = await find(api, place, name)
        try:
            events = await api.list(EVENT, place)
        except KubeError:
            events = []  # a user who may not read events still gets the answer
        async with target.api(HURRY) as hurry:
            said = await live(hurry, place, name)
        return explanation_of(
            observe(manifest),
            deleting=bool(manifest["metadata"].get("deletionTimestamp")),
            events=events,
            now=datetime.datetime.now(datetime.UTC),
            state=said.state,
        )

    found = target.run(work)
    if as_json:
        typer.echo(json.dumps(_plain(found), indent=2))
    else:
        typer.echo("\n".join(lines(found)))
    if not found.ready:
        raise typer.Exit(1)


def lines(found: Explanation) -> list[str]:
    """Return the explanation as text."""
    shown = [found.headline]
    for problem in found.problems:
        since = f" for {problem.since}" if problem.since else ""
        shown += ["", f"{problem.condition}: {problem.reason}{since}"]
        shown += [f"  {line}" for line in problem.message.splitlines()]
        if problem.meaning:
            shown.append(f"  Meaning: {problem.meaning}")
        if problem.step:
            shown.append(f"  Next:    {problem.step}")
    if found.notes:
        shown += ["", *found.notes]
    if found.events:
        shown += ["", "Last warnings:", *(f"  {event}" for event in found.events)]
    return shown


def _plain(found: Explanation) -> dict[str, Any]:
    return dataclasses.asdict(found)
