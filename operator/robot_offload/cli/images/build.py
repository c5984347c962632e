"""`robot-offload build`: builds the image that `robot-offload dockerfile` describes."""

from __future__ import annotations

import os
import shlex
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated, Any, Final

import typer

from robot_offload.api.v1alpha1.build_values import commit
from robot_offload.cli.app import example_text
from robot_offload.cli.images.dockerfile import (
    Agent,
    Options,
    ResourceFile,
    SpecFile,
    by_option,
    checked_text,
    with_flags,
)
from robot_offload.errors import InputError
from robot_offload.images import builders
from robot_offload.images.builders import TOOLS, Request
from robot_offload.images.spec import BuildSpec, OverlaySpec

EXAMPLES: Final = (
    "robot-offload build --tag registry.example/controller:1 --git https://git.example/robot.git --pin --push \\",
    "    --package controller --executable controller_server",
    "robot-offload build --tag controller:dev --context ~/ws --workspace src --package controller --executable server",
    "robot-offload build --tag controller:dev --spec build.yaml --dry-run",
    "robot-offload build --tag registry.example/controller:1 --platform linux/amd64 --platform linux/arm64 --push ...",
    "robot-offload build --tag controller:1 --credentials Token --secret id=git-credentials,src=token.txt ...",
)


def add_to(app: typer.Typer) -> None:
    """Add the command to `app`."""
    app.command("build", epilog=example_text(EXAMPLES))(with_flags(build_command))


def build_command(
    *,
    tag: Annotated[str, typer.Option("--tag", "-t", metavar="IMAGE", help="The image's name, registry/name:tag.")],
    context: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Folder that --workspace and --repos are in. Default: this folder."),
    ] = None,
    push: Annotated[bool, typer.Option("--push", help="Push the image to its registry after the build.")] = False,
    platform: Annotated[
        list[str] | None, typer.Option(metavar="OS/ARCH", help="E.g. linux/arm64; may be repeated. Default: this one.")
    ] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Print the Dockerfile and the commands only.")] = False,
    pin: Annotated[bool, typer.Option("--pin", help="Look up the commit of --ref now and build that one.")] = False,
    builder: Annotated[
        str | None, typer.Option(metavar="NAME", help="docker, podman or buildah. Default: the first that works here.")
    ] = None,
    secret: Annotated[
        list[str] | None,
        typer.Option(metavar="id=NAME,src=FILE", help="File for git-credentials or known_hosts; may be repeated."),
    ] = None,
    ssh: Annotated[bool, typer.Option("--ssh", help="Lend the build your ssh agent (--credentials SSH).")] = False,
    builder_argument: Annotated[
        list[str] | None, typer.Option(metavar="TEXT", help="Further argument of the builder; may be repeated.")
    ] = None,
    file: ResourceFile = None,
    agent: Agent = False,
    spec: SpecFile = None,
    **given: Any,
) -> None:
    """Build a ROS 2 node's image with docker, podman or buildah.

    Takes all options of `robot-offload dockerfile`. With SOURCE_DATE_EPOCH set, all times in the image are that one.
    Ends with 0, with 1 when the builder failed, and with 2 when an option cannot be used.
    """
    options = Options(agent, spec, by_option(given), file)
    wanted = _pinned(options.spec()) if pin else options.spec()
    text = checked_text(options, wanted)
    with ExitStack() as stack:
        request = Request(
            tag=tag,
            context=_context(wanted, context, stack),
            platforms=tuple(platform or ()),
            push=push,
            health_check=isinstance(wanted, BuildSpec) and wanted.health_check != "None",
            source_date_epoch=builders.source_date_epoch(os.environ),
            extra=(
                *(word for value in secret or () for word in ("--secret", value)),
                *(("--ssh", "default") if ssh else ()),
                *(builder_argument or ()),
            ),
        )
        _run(_tool(builder, dry_run), request, text, dry_run)


def _run(tool: builders.Tool, request: Request, text: str, dry_run: bool) -> None:
    if dry_run:
        typer.echo(text)
        for command in builders.commands(tool, request):
            typer.echo(f"# {shlex.join(command)}")
        return
    typer.echo(f"Building {request.tag} with {tool}", err=True)
    started_s = time.monotonic()
    builders.run(tool, request, text)
    done = "Built and pushed" if request.push else "Built"
    typer.echo(f"{done} {request.tag} in {time.monotonic() - started_s:.0f} s", err=True)


def _tool(name: str | None, dry_run: bool) -> builders.Tool:
    """Return the builder; a dry run accepts one that is not installed."""
    known = next((tool for tool in TOOLS if tool == name), None)
    if name is not None and known is None:
        raise InputError(f"--builder: {name!r} is not known; write docker, podman or buildah")
    return known if dry_run and known else builders.choose(known)


def _pinned(spec: BuildSpec | OverlaySpec) -> BuildSpec:
    """Return `spec` with the commit to which its branch or tag points now."""
    if not isinstance(spec, BuildSpec) or spec.git is None:
        raise InputError("--pin: goes with --git only")
    if commit(spec.git.ref):
        return spec
    found = builders.look_up_commit(spec.git.url, spec.git.ref)
    typer.echo(f"{spec.git.ref} is {found}", err=True)
    return spec.model_copy(update={"git": spec.git.model_copy(update={"ref": found})})


def _context(spec: BuildSpec | OverlaySpec, folder: Path | None, stack: ExitStack) -> Path:
    """Return the folder from which the Dockerfile copies; an empty one if it copies nothing."""
    if isinstance(spec, BuildSpec) and spec.git is None:
        folder = folder or Path()
        if not folder.is_dir():
            raise InputError(f"--context: {folder}: there is no such folder")
        return folder
    if folder is not None:
        raise InputError("--context: goes with --workspace and --repos only")
    return Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="robot-offload-build-")))
