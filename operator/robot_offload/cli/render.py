"""`robot-offload render`: writes what is derived from a RobotOffload, to look at or to use without a cluster."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from robot_offload.cli.app import commands, example_text
from robot_offload.errors import InputError
from robot_offload.loading import load
from robot_offload.render.agent_config import AgentSite, agent_config

EXAMPLES = (
    "robot-offload render agent-config wheelchair.yaml --side cloud --output cloud.yaml",
    "robot-offload render agent-config wheelchair.yaml --side robot --host edge.example --output robot.yaml",
    "robot-offload-agent robot --params robot.yaml",
)
DEFAULT_HOSTS = {"robot": "127.0.0.1", "cloud": "0.0.0.0"}  # noqa: S104 - the cloud's agent serves every interface
CERTIFICATE_AUTHORITIES = {"robot": "server-ca.pem", "cloud": "client-ca.pem"}
"""Each side trusts the authority of the other one."""


class SideOption(str, Enum):
    """The values of `--side`."""

    ROBOT = "robot"
    CLOUD = "cloud"


def add_to(app: typer.Typer) -> None:
    """Adds the commands to `app`."""
    group = commands("Print what is derived from a RobotOffload.", EXAMPLES)
    # A callback keeps it a group while it has a single command.
    group.callback()(lambda: None)
    group.command("agent-config", epilog=example_text(EXAMPLES))(agent_config_command)
    app.add_typer(group, name="render")


def agent_config_command(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="YAML file with one RobotOffload.")],
    side: Annotated[SideOption, typer.Option(help="Whose agent it is for.")],
    host: Annotated[
        str,
        typer.Option(
            help="Robot: name or address of the cloud, default 127.0.0.1. Cloud: address to listen on, default 0.0.0.0."
        ),
    ] = "",
    certificates: Annotated[
        Path, typer.Option(help="Folder with server-ca.pem, client-ca.pem and each side's .pem and .key.")
    ] = Path("certificates"),
    runtime_dir: Annotated[str, typer.Option(help="Folder of the agent's sockets. Default: the agent's own.")] = "",
    state_dir: Annotated[
        str, typer.Option(help="Folder for what the agent keeps over a reboot. Default: the agent's own.")
    ] = "",
    realtime: Annotated[bool, typer.Option(help="Ask for real-time priority of the heartbeats.")] = False,
    output: Annotated[Path | None, typer.Option(help="File to write. Default: standard output.")] = None,
) -> None:
    """Print the agent configuration of one side, a ROS 2 parameter file."""
    offload = load(file)
    site = AgentSite(
        side=side.value,
        host=host or DEFAULT_HOSTS[side.value],
        ca=str(certificates / CERTIFICATE_AUTHORITIES[side.value]),
        certificate=str(certificates / f"{side.value}.pem"),
        private_key=str(certificates / f"{side.value}.key"),
        runtime_dir=runtime_dir,
        state_dir=state_dir,
        realtime=realtime,
    )
    text = agent_config(offload, site)
    if output is None:
        typer.echo(text, nl=False)
        return
    try:
        output.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"{output}: cannot be written: {error.strerror}") from error
