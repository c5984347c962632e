"""`robot-offload pair`: robot and workstation without Kubernetes, from a file that a cluster accepts later."""

from __future__ import annotations

import datetime
import uuid
from pathlib import Path
from typing import Annotated

import typer

from robot_offload.api.files import load
from robot_offload.cli.app import example_text
from robot_offload.cli.bundle import folder
from robot_offload.cli.own_images import default_images
from robot_offload.render.bundle import PRIVATE_KEY
from robot_offload.render.pair import WORKSTATION_KEY, Pairing, pair

EXAMPLES = (
    "robot-offload pair wheelchair.yaml --host workstation.local -o wheelchair",
    "scp -r wheelchair/robot robot:/tmp/ && scp -r wheelchair/workstation workstation.local:/tmp/",
)
DAYS = 365


def add_to(app: typer.Typer) -> None:
    """Add the command to `app`."""
    app.command("pair", epilog=example_text(EXAMPLES))(pair_command)


def pair_command(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="YAML file with one RobotOffload.")],
    *,
    host: Annotated[str, typer.Option(help="DNS name or IP address by which the robot reaches the workstation.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="Folder to write both folders to.")],
    days: Annotated[int, typer.Option(min=1, help="How long the certificates are valid, days.")] = DAYS,
    robot_folder: Annotated[
        str, typer.Option(help="Where the folder will lie on the robot. Default: /etc/robot-offload/NAME.")
    ] = "",
    workstation_folder: Annotated[
        str, typer.Option(help="The same on the workstation. Default: /etc/robot-offload/NAME-cloud.")
    ] = "",
    force: Annotated[bool, typer.Option("--force", help="Replace the folders of an earlier pairing.")] = False,
) -> None:
    """Write robot and workstation as two folders: certificates, agent configurations, units, compose files."""
    offload = load(file)
    now = datetime.datetime.now(datetime.UTC)
    uid = str(uuid.uuid4())
    made = pair(offload, Pairing(uid, host, default_images(), now, days, robot_folder, workstation_folder))
    name, namespace = offload.metadata.name, offload.metadata.namespace or "default"
    for side, files, key in (
        ("robot", made.robot, PRIVATE_KEY),
        ("workstation", made.workstation, WORKSTATION_KEY),
    ):
        mark = folder.Mark(namespace, name, uid, 0, tuple(sorted(files)))
        folder.write(output / side, files, [key], mark, force=force)
    end = now + datetime.timedelta(days=days)
    typer.echo(f"{output}: robot and workstation of {name}; the certificates end on {end:%Y-%m-%d}")
    typer.echo(f"Next: copy {output}/robot to the robot and {output}/workstation to {host}; follow README.md in each.")
