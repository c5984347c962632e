"""`robot-offload render`: write what is derived from a RobotOffload, to look at or to use without a cluster."""

from __future__ import annotations

import datetime
from enum import Enum
from pathlib import Path
from typing import Annotated, Any, Final

import typer
import yaml

from robot_offload.api.files import load
from robot_offload.api.v1alpha1.parsing import parse_text
from robot_offload.api.v1alpha1.rules import CLUSTER_CHECKS
from robot_offload.cli.app import CommandsWithDefault, commands, example_text
from robot_offload.cli.own_images import default_images
from robot_offload.cli.sources import sources
from robot_offload.decide.builds import Before, decide
from robot_offload.errors import InputError
from robot_offload.kube.port import Manifest
from robot_offload.objects.facts import Facts
from robot_offload.objects.parent import Parent
from robot_offload.render.agent_config import AgentSite, agent_config
from robot_offload.render.children import children
from robot_offload.transport import discovery

FILE_EXAMPLES = (
    "robot-offload render wheelchair.yaml",
    "robot-offload render wheelchair.yaml | grep -E '^kind|^  name:'",
    "robot-offload render - < wheelchair.yaml > children.yaml",
)
AGENT_EXAMPLES = (
    "robot-offload render agent-config wheelchair.yaml --side cloud --output cloud.yaml",
    "robot-offload render agent-config wheelchair.yaml --side robot --host edge.example --output robot.yaml",
    "robot-offload-agent robot --params robot.yaml",
)
DEFAULT_HOSTS = {"robot": "127.0.0.1", "cloud": "0.0.0.0"}  # noqa: S104 - the cloud's agent serves every interface
CERTIFICATE_AUTHORITIES = {"robot": "server-ca.pem", "cloud": "client-ca.pem"}
"""Each side trusts the authority of the other one."""
HEADER: Final = """\
# What the operator makes of RobotOffload {name}, without the Secrets (it makes their keys) and without owners.
# To look at and to compare; to have it made, apply the RobotOffload itself.
"""


class SideOption(str, Enum):
    """The values of `--side`."""

    ROBOT = "robot"
    CLOUD = "cloud"


def add_to(app: typer.Typer) -> None:
    """Add the commands to `app`."""
    group = commands(
        "Print what is derived from a RobotOffload: with a FILE all objects in the cluster, without asking any "
        "cluster; or one of the files below.",
        [*FILE_EXAMPLES, *AGENT_EXAMPLES[:1]],
        CommandsWithDefault,
    )
    group.command("file", epilog=example_text(FILE_EXAMPLES))(file_command)
    group.command("agent-config", epilog=example_text(AGENT_EXAMPLES))(agent_config_command)
    app.add_typer(group, name="render")


def file_command(
    file: Annotated[str, typer.Argument(metavar="FILE", help="YAML file with one RobotOffload, or - .")],
    *,
    namespace: Annotated[
        str, typer.Option("--namespace", "-n", help="Namespace of the objects. Default: the file's, or default.")
    ] = "",
    robot_connected: Annotated[
        bool, typer.Option("--robot-connected", help="As while the robot is connected: Cold nodes have pods, too.")
    ] = False,
    asleep: Annotated[
        bool, typer.Option("--asleep", help="As after spec.scale.idleTimeout without the robot: no node has pods.")
    ] = False,
) -> None:
    """Print all objects that the operator makes of a RobotOffload, as YAML. No cluster is asked."""
    if robot_connected and asleep:
        raise InputError("--robot-connected, --asleep: one of them at a time")
    [source] = sources([file])
    offload = parse_text(source.text, source.name, rules=CLUSTER_CHECKS)
    facts = Facts(
        namespace=namespace or offload.metadata.namespace or "default",
        uid="",
        generation=1,
        images=default_images(),
        nodes_wanted=not asleep,
        robot_connected=robot_connected,
        discovery_hosts=discovery.names(offload),  # the cluster assigns their addresses
    )
    parent = Parent(offload, facts)
    # As at the very beginning: the Secrets that builds need exist, but no image.
    nothing = Before({}, (), frozenset(), datetime.datetime.fromtimestamp(0, datetime.UTC))
    builds = decide(parent, nothing, "").manifests
    manifests = [_without_owner(manifest) for manifest in (*builds, *children(parent))]
    typer.echo(HEADER.format(name=offload.metadata.name), nl=False)
    typer.echo(yaml.safe_dump_all(manifests, sort_keys=False, width=120, explicit_start=True), nl=False)


def _without_owner(manifest: Manifest) -> Manifest:
    """Return it without owner reference: with a missing owner, the cluster would delete what is applied."""
    metadata: dict[str, Any] = {key: value for key, value in manifest["metadata"].items() if key != "ownerReferences"}
    return {**manifest, "metadata": metadata}


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
