"""`robot-offload init`: a first RobotOffload from five questions."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Annotated

import typer

from robot_offload.cli.app import example_text
from robot_offload.cli.files import write_new
from robot_offload.errors import InputError
from robot_offload.survey.first import Answers, first
from robot_offload.survey.written import written

EXAMPLES = (
    "robot-offload init -o walker.yaml",
    "robot-offload init --name walker --node nav --publishes /cmd_vel:geometry_msgs/msg/Twist:20 -o walker.yaml",
    "robot-offload init --name walker --node detector --publishes /boxes | robot-offload validate -",
)
QUESTIONS = {
    "--name": "Name of the robot (lower-case letters, digits, dashes)",
    "--node": "Node that shall run on the robot and in the cloud (as in `ros2 node list`, without namespace)",
    "--publishes": "What it publishes and others hear (TOPIC:TYPE:RATE, several separated by spaces)",
    "--hears": "Topics that it hears (separated by spaces; empty: none)",
    "--stop": "Service that stops the robot when the node is missing (std_srvs/srv/SetBool; empty: none)",
}


def add_to(app: typer.Typer) -> None:
    """Add the command to `app`."""
    app.command("init", epilog=example_text(EXAMPLES))(init)


def init(
    *,
    name: Annotated[str, typer.Option(help="The robot's name: lower-case letters, digits and dashes.")] = "",
    node: Annotated[str, typer.Option(help="The node that shall run on both sides, without its namespace.")] = "",
    publishes: Annotated[
        list[str] | None,
        typer.Option(
            metavar="TOPIC[:TYPE[:RATE]]", help="What it publishes and others hear; RATE is in Hz. Repeatable."
        ),
    ] = None,
    hears: Annotated[list[str] | None, typer.Option(metavar="TOPIC", help="A topic that it hears. Repeatable.")] = None,
    stop: Annotated[
        str | None,
        typer.Option(metavar="SERVICE", help="A std_srvs/srv/SetBool that stops the robot; makes the node core."),
    ] = None,
    domain_id: Annotated[
        int | None, typer.Option(min=0, max=232, help="The robot's ROS_DOMAIN_ID. Default: this shell's, or 0.")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE", help="File to write. Default: standard output.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace FILE if it is there already.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the RobotOffload as JSON, without comments.")] = False,
) -> None:
    """Write a first RobotOffload: asks five questions, or takes the answers as options.

    On a terminal it asks for what no option says; elsewhere --name, --node and --publishes are needed. Where the
    robot's graph runs, `robot-offload import` answers by itself. Ends with 0, or with 2 when an answer cannot be used.
    """
    asking = sys.stdin.isatty() and not (name and node and publishes)
    if not asking:
        _require({"--name": name, "--node": node, "--publishes": publishes})
    answers = Answers(
        name or _ask("--name"),
        node or _ask("--node"),
        publishes or _ask("--publishes").split(),
        _ask("--hears").split() if asking and hears is None else hears or [],
        _ask("--stop") if asking and stop is None else stop or "",
        _domain() if domain_id is None else domain_id,
    )
    sketch = first(answers)
    text = json.dumps(sketch.values(), indent=2) + "\n" if as_json else written(sketch)
    if output is None:
        typer.echo(text, nl=False)
        return
    write_new(output, text, force=force)
    typer.echo(f"{output}: {answers.node} of {answers.name} on both sides")
    typer.echo(f"Next: add its run block, then robot-offload validate {output}")


def _require(given: dict[str, object]) -> None:
    missing = [option for option, value in given.items() if not value]
    if missing:
        raise InputError(
            f"init: {', '.join(missing)} is missing, and this is not a terminal to ask at; see init --help"
        )


def _ask(option: str) -> str:
    return str(
        typer.prompt(QUESTIONS[option], default="" if option in ("--hears", "--stop") else None, err=True)
    ).strip()


def _domain() -> int:
    text = os.environ.get("ROS_DOMAIN_ID") or "0"
    if not text.isdecimal():
        raise InputError(f"ROS_DOMAIN_ID is {text[:20]!r}, which is not a number; give --domain-id")
    return int(text)
