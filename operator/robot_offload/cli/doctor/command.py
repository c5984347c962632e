"""`robot-offload doctor`: find problems before they do harm."""

from __future__ import annotations

import asyncio
import dataclasses
import json
from collections.abc import Iterator, Sequence
from typing import Annotated, Final

import typer

from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.cli.app import example_text
from robot_offload.cli.cluster import HURRY, Context, Kubeconfig, Namespace, Target
from robot_offload.cli.doctor import graph, machine
from robot_offload.cli.doctor.checks import Finding
from robot_offload.cli.doctor.examine import examine_cluster, examine_one
from robot_offload.errors import InputError

EXAMPLES = (
    "robot-offload doctor",
    "robot-offload doctor wheelchair-7",
    "robot-offload doctor --local",
    "kubectl offload doctor wheelchair-7 --json | jq -r '.[] | select(.level == \"error\")'",
)
MARKS: Final = {"ok": "ok     ", "warning": "WARNING", "error": "ERROR  ", "unknown": "?      "}


def add_to(app: typer.Typer) -> None:
    """Add the command to `app`."""
    app.command("doctor", epilog=example_text(EXAMPLES))(doctor)


def doctor(
    name: Annotated[str | None, typer.Argument(metavar="[NAME]", help="Also look at this RobotOffload.")] = None,
    *,
    local: Annotated[bool, typer.Option("--local", help="Only this machine: no cluster is asked.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the findings as JSON, one list.")] = False,
    namespace: Namespace = None,
    context: Context = None,
    kubeconfig: Kubeconfig = None,
) -> None:
    """Look for what would bite, before it does: on this machine, in the cluster, and in one RobotOffload.

    Run it where you work, and on the robot. Each finding comes with the next step. Ends with 0, with 1 when there is
    an error (warnings are only told).
    """
    if local and name is not None:
        raise InputError("--local asks no cluster, so it cannot look at a RobotOffload; leave out one of the two")
    findings: list[Finding] = []
    offload = None
    if not local:
        target = Target(kubeconfig, context, namespace)
        findings, offload = asyncio.run(_ask(target, name))
    domain_id = offload.spec.robot.domain_id if offload is not None else None
    here = machine.look(domain_id)
    findings += machine.judge(here, offload)
    if offload is not None and "ROS_DISTRO" in here.environment:
        topics = [output.topic for _, output in offload.spec.collected_outputs]
        findings += graph.judge(graph.ask(topics)) if topics else []
    if as_json:
        typer.echo(json.dumps([dataclasses.asdict(finding) for finding in findings], indent=2))
    else:
        typer.echo("\n".join(lines(findings)))
    if any(finding.level == "error" for finding in findings):
        raise typer.Exit(1)


def lines(findings: Sequence[Finding]) -> Iterator[str]:
    """Yield the findings as text, and the sum."""
    width = max((len(finding.check) for finding in findings), default=0)
    for finding in findings:
        yield f"{MARKS[finding.level]} {finding.check:<{width}}  {finding.message}"
        if finding.step:
            yield f"{'':<8}{'':<{width}}  Next: {finding.step}"
    counts = {level: sum(finding.level == level for finding in findings) for level in MARKS}
    yield f"{counts['error']} errors, {counts['warning']} warnings, {counts['unknown']} not known, {counts['ok']} fine"


async def _ask(target: Target, name: str | None) -> tuple[list[Finding], RobotOffload | None]:
    async with target.api() as api, target.api(HURRY) as hurry:
        findings = await examine_cluster(api)
        blind = any(finding.check in ("ApiServer", "Definition") and finding.level == "error" for finding in findings)
        if name is None or blind:
            return findings, None
        more, offload = await examine_one(api, hurry, target.namespace, name)
        return [*findings, *more], offload
