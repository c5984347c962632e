"""`robot-offload import`: a first RobotOffload from a running robot."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from robot_offload.api.files import read_text
from robot_offload.cli.app import example_text
from robot_offload.cli.files import must_be_new, write_new
from robot_offload.survey import asked
from robot_offload.survey.fit import fitted
from robot_offload.survey.proposal import propose
from robot_offload.survey.sketch import Sketch
from robot_offload.survey.snapshot import GraphSnapshot, read, write
from robot_offload.survey.written import written

EXAMPLES = (
    "robot-offload import -o robot.yaml",
    "robot-offload import --seconds 30 --snapshot graph.json -o robot.yaml",
    "robot-offload import --from graph.json --name walker | robot-offload validate -",
    "robot-offload import --program > look.py   # on a robot with another Python: python3 look.py > graph.json",
)
SECONDS = 10.0


def add_to(app: typer.Typer) -> None:
    """Add the command to `app`."""
    app.command("import", epilog=example_text(EXAMPLES))(import_command)


def import_command(
    *,
    seconds: Annotated[float, typer.Option(min=1, max=600, help="How long to look, seconds, from 1 to 600.")] = SECONDS,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE", help="File to write. Default: standard output.")
    ] = None,
    name: Annotated[str, typer.Option(help="The robot's name in the file. Default: the host's name.")] = "",
    snapshot: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Also keep what was seen, as JSON for --from.")
    ] = None,
    source: Annotated[
        Path | None, typer.Option("--from", metavar="FILE", help="Use what --snapshot or --program kept; needs no ROS.")
    ] = None,
    program: Annotated[
        bool, typer.Option("--program", help="Print the program that looks, for a robot without this command line.")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace FILE if it is there already.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the RobotOffload as JSON, without comments.")] = False,
) -> None:
    """Look at the running ROS graph and propose a RobotOffload for it.

    Reads only: topics with type, quality of service, rate and bandwidth, services, actions, transforms, parameters, CPU
    and memory of the processes of this host. Looks in the ROS domain and with the ROS middleware of this shell. What is
    written is valid, and a proposal: comments give the figures and reasons. Ends with 0, with 1 when there is no node,
    with 2 when an option is wrong or rclpy is missing.
    """
    if program:
        typer.echo(asked.PROGRAM.read_text(encoding="utf-8"), nl=False)
        return
    must_be_new(output, force=force)
    graph = read(read_text(source), str(source)) if source is not None else asked.look(seconds)
    if snapshot is not None:
        write_new(snapshot, write(graph), force=True)
    sketch = propose(graph, name, str((output or Path("x")).resolve().parent))
    fitted(sketch)
    _put(sketch, graph, output, as_json=as_json)


def _put(sketch: Sketch, graph: GraphSnapshot, output: Path | None, *, as_json: bool) -> None:
    text = json.dumps(sketch.values(), indent=2) + "\n" if as_json else written(sketch)
    if output is None:
        typer.echo(text, nl=False)
        return
    write_new(output, text, force=True)
    moved = [node.name for node in sketch.nodes if node.placement != "Robot"]
    typer.echo(
        f"{output}: {len(sketch.nodes)} of {len(graph.nodes)} nodes; leave the robot: {', '.join(moved) or 'none'}"
    )
    typer.echo(f"Next: read its comments, then robot-offload validate {output}")
