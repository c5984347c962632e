"""`robot-offload import`: a first RobotOffload from a robot that runs."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Annotated

import typer

from robot_offload.api.files import read_text
from robot_offload.api.v1alpha1.quantities import parse_duration
from robot_offload.cli.app import example_text
from robot_offload.cli.files import must_be_new, write_new
from robot_offload.cli.lab import advice
from robot_offload.errors import InputError
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
    "robot-offload import --from graph.json --advise --rtt 20ms --bandwidth 20Mbit/s --picture cuts.svg",
    "robot-offload import --program > look.py   # on a robot with another Python: python3 look.py > graph.json",
)
SECONDS = 10.0


def add_to(app: typer.Typer) -> None:
    """Adds the command to `app`."""
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
    advise: Annotated[
        bool, typer.Option("--advise", help="Propose what to move: the cuts that save most CPU. Needs the lab.")
    ] = False,
    bandwidth: Annotated[
        str, typer.Option(metavar="RATE", help="With --advise: what the link carries, both ways together, in Mbit/s.")
    ] = "20Mbit/s",
    rtt: Annotated[str, typer.Option(metavar="TIME", help="With --advise: the link there and back.")] = "20ms",
    tolerance: Annotated[
        str, typer.Option(metavar="TIME", help="With --advise: how much slower a loop through the cloud may be.")
    ] = "30ms",
    cloud_speed: Annotated[
        float, typer.Option(min=0.1, max=100, help="With --advise: how many times faster nodes are in the cloud.")
    ] = 1.0,
    picture: Annotated[
        Path | None, typer.Option(metavar="FILE", help="With --advise: a picture of the cuts, e.g. cuts.svg.")
    ] = None,
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
    advised = None
    if advise:
        limits = {
            "bandwidth": _bytes_per_s(bandwidth),
            "rtt_s": _s("--rtt", rtt),
            "tolerance_s": _s("--tolerance", tolerance),
        }
        advised = advice().advise(graph, **limits, speedup=cloud_speed, picture=picture)
    folder = str((output or Path("x")).resolve().parent)
    sketch = propose(graph, name, advised.placements if advised else None, folder)
    if advised:
        sketch.head += advised.lines
        typer.echo("\n".join(advised.lines), err=True)
        if "switching" in sketch.spec:
            sketch.spec["switching"]["latency"]["tolerance"] = tolerance
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


def _bytes_per_s(text: str) -> float:
    match = re.fullmatch(r"([0-9]+(?:\.[0-9]+)?)\s*Mbit(?:/s)?", text)
    if match is None or float(match[1]) <= 0:
        raise InputError(f"--bandwidth: {text!r} is no bandwidth; write for example 20Mbit/s")
    return float(match[1]) * 1e6 / 8


def _s(option: str, text: str) -> float:
    try:
        return parse_duration(text) / 1e3
    except ValueError as error:
        raise InputError(f"{option}: {error}") from None
