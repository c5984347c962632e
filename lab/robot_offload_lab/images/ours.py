"""Builds the project's own images: `python -m robot_offload_lab.images.ours`, also `make images`.

The Dockerfiles are in `images/`; README.md there describes the content of each image.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Final

import typer

from robot_offload.errors import InputError, RobotOffloadError
from robot_offload.images.builders import (
    TOOLS,
    BuildError,
    Request,
    Tool,
    choose,
    commands,
    run,
    source_date_epoch,
)
from robot_offload_lab.images import wheels_base

ROOT: Final = Path(__file__).parents[3]
"""The root of the repository: the build context of our images."""
REGISTRY: Final = "registry.robotoffload.dev"
COMPILERS: Final[wheels_base.Stage] = "ros-compilers"
"""The stage of `images/wheels-base` in which interface packages are made."""


@dataclass(frozen=True, slots=True)
class OwnImage:
    """One of our images.

    Attributes:
        name: in the registry.
        wheels_stage: the stage of `images/wheels-base` that can be its base; empty: none can.
        example: the example whose nodes it holds; empty: it belongs to no example.
        over: our image on which it is layered; empty: none.
    """

    name: str
    wheels_stage: wheels_base.Stage | None
    example: str = ""
    over: str = ""

    @property
    def compiles(self) -> bool:
        """Return whether interface packages are built for it, which needs compilers."""
        return not self.over and (ROOT / "examples" / self.example / "interfaces").is_dir()

    @property
    def folder(self) -> Path:
        """Return where its Dockerfile is."""
        name = "agent" if self.over else self.name
        if self.example and not self.over:
            name = "example-interfaces" if self.compiles else "example"
        return ROOT / "images" / name


OURS: Final = (
    OwnImage("agent", "ros-core"),
    OwnImage("operator", "system"),
    OwnImage("discovery", "ros-core"),
    OwnImage("router", None),
    OwnImage("git", "system"),
    OwnImage("examples/talker", "ros-core", example="talker"),
    OwnImage("examples/wheelchair", "ros-core", example="wheelchair"),
    OwnImage("examples/sedia", "ros-core", example="sedia"),
    OwnImage("examples/sedia-agent", "ros-core", example="sedia", over="examples/sedia"),
)


@dataclass(frozen=True, slots=True)
class BuildSettings:
    """Settings that all images share.

    Attributes:
        registry: the registry of the images.
        version: version of the project; the tag.
        revision: the commit.
        platforms: see `builders.Request`.
        push: see `builders.Request`.
        source_date_epoch: see `builders.Request`.
        extra: further arguments of the builder.
    """

    registry: str
    version: str
    revision: str
    platforms: tuple[str, ...] = ()
    push: bool = False
    source_date_epoch: int | None = None
    extra: tuple[str, ...] = ()


def request(
    image: OwnImage, settings: BuildSettings, base: str | None = None, build_base: str | None = None
) -> Request:
    """Return the request to build one of our images.

    Args:
        image: which.
        settings: what all images share.
        base: replaces the base image that its Dockerfile names.
        build_base: replaces the image in which interface packages are built.
    """
    arguments = {"VERSION": settings.version, "REVISION": settings.revision}
    if image.over:
        base = base or f"{settings.registry}/{image.over}:{settings.version}"
    elif image.example:
        arguments["EXAMPLE"] = image.example
    if build_base and image.compiles:
        arguments["BUILD_BASE"] = build_base
    return Request(
        tag=f"{settings.registry}/{image.name}:{settings.version}",
        context=ROOT,
        platforms=settings.platforms,
        push=settings.push,
        dockerfile=str(image.folder / "Dockerfile"),
        ignore_file=image.folder / "Dockerfile.dockerignore",
        build_arguments=({"BASE": base} if base else {}) | arguments,
        source_date_epoch=settings.source_date_epoch,
        extra=settings.extra,
    )


def build(
    names: Annotated[list[str] | None, typer.Argument(metavar="[NAME]...", help="Default: all of them.")] = None,
    *,
    registry: Annotated[str, typer.Option(help="Where they belong.")] = REGISTRY,
    push: Annotated[bool, typer.Option("--push", help="Push them after the build.")] = False,
    digests: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="With --push: write the digest of each image there, for `make release`."),
    ] = None,
    save: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Write an archive of each, for `kind load image-archive` or `ctr images import`."
        ),
    ] = None,
    platform: Annotated[list[str] | None, typer.Option(metavar="OS/ARCH", help="May be repeated.")] = None,
    base: Annotated[
        list[str] | None, typer.Option(metavar="NAME=IMAGE", help="Another base of one image; may be repeated.")
    ] = None,
    wheels: Annotated[
        bool,
        typer.Option("--wheels", help="Without a container registry: make a base of Debian and Python wheels first."),
    ] = False,
    builder: Annotated[str | None, typer.Option(metavar="NAME", help="docker, podman or buildah.")] = None,
    builder_argument: Annotated[list[str] | None, typer.Option(metavar="TEXT", help="May be repeated.")] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Print the commands only.")] = False,
) -> None:
    """Build our own images; one that fails does not keep the others from being built."""
    if not (ROOT / "images").is_dir():
        raise InputError("our own images are built in a checkout of the repository, with the package installed from it")
    bases = dict(_base(text) for text in base or ())
    chosen = _chosen(names or [], wheels)
    known = next((tool for tool in TOOLS if tool == builder), None)
    if builder and known is None:
        raise InputError(f"--builder: {builder!r} is not known; write docker, podman or buildah")
    tool = known if dry_run and known else choose(known)
    extra = tuple(builder_argument or ())
    extra = (*wheels_base.lent(tool), *extra) if wheels else extra
    settings = BuildSettings(
        registry=registry,
        version=version("robot-offload"),
        revision=_revision(),
        platforms=tuple(platform or ()),
        push=push,
        source_date_epoch=source_date_epoch(os.environ),
        extra=extra,
    )
    if wheels and not dry_run:
        wheels_base.build(tool, ROOT, extra, _stages(chosen))
    compilers = wheels_base.tag(COMPILERS)
    failed, pushed = [], {}
    for image in chosen:
        wanted = request(
            image, settings, bases.get(image.name) or stand_in(image, wheels), compilers if wheels else None
        )
        try:
            _build_one(tool, wanted, dry_run)
            if push and digests and not dry_run:
                pushed[image.name] = registry_digest(tool, wanted.tag)
            if save:
                _save_one(tool, wanted.tag, save / f"{image.name.replace('/', '-')}.tar", dry_run)
        except BuildError as error:
            typer.echo(str(error), err=True)
            failed.append(image.name)
    if digests and pushed:
        digests.parent.mkdir(parents=True, exist_ok=True)
        digests.write_text("".join(f"{name} {digest}\n" for name, digest in sorted(pushed.items())), encoding="utf-8")
    if failed:
        raise BuildError(f"not built: {', '.join(failed)}")


def stand_in(image: OwnImage, wheels: bool) -> str | None:
    """Return the wheels base for an image; None: the base that its Dockerfile names, or another image of ours."""
    return wheels_base.tag(image.wheels_stage) if wheels and image.wheels_stage and not image.over else None


def _stages(images: Sequence[OwnImage]) -> set[wheels_base.Stage]:
    stages = {image.wheels_stage for image in images if image.wheels_stage}
    return stages | ({COMPILERS} if any(image.compiles for image in images) else set())


def registry_digest(tool: Tool, tag: str) -> str:
    """Return the digest of a just pushed image in a registry.

    Raises:
        BuildError: the digest cannot be determined.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "digest"
        command = {
            # Images that are there already are not sent again.
            "buildah": ("buildah", "push", "--quiet", "--digestfile", str(file), tag),
            "podman": ("podman", "push", "--quiet", "--digestfile", str(file), tag),
            "docker": ("docker", "buildx", "imagetools", "inspect", "--format", "{{.Manifest.Digest}}", tag),
        }[tool]
        asked = subprocess.run(command, capture_output=True, text=True, check=False, timeout=600.0)
        found = (file.read_text(encoding="utf-8") if file.exists() else asked.stdout).strip()
    if asked.returncode != 0 or re.fullmatch(r"sha256:[0-9a-f]{64}", found) is None:
        raise BuildError(f"{tag}: its digest is not known: {asked.stderr.strip() or found}")
    return found


def _save_one(tool: Tool, tag: str, archive: Path, dry_run: bool) -> None:
    command = {
        "buildah": ("buildah", "push", "--quiet", tag, f"docker-archive:{archive}:{tag}"),
        "podman": ("podman", "save", "--quiet", "--output", str(archive), tag),
        "docker": ("docker", "save", "--output", str(archive), tag),
    }[tool]
    if dry_run:
        typer.echo(shlex.join(command))
        return
    archive.parent.mkdir(parents=True, exist_ok=True)
    archive.unlink(missing_ok=True)
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=600.0)
    if done.returncode != 0:
        raise BuildError(f"{tag}: cannot be written to {archive}: {done.stderr.strip()}")
    typer.echo(f"{archive}")


def _build_one(tool: Tool, wanted: Request, dry_run: bool) -> None:
    if dry_run:
        for command in commands(tool, wanted):
            typer.echo(shlex.join(command))
        return
    run(tool, wanted)
    asked = subprocess.run(
        (tool, "images", "--format", "{{.Size}}", wanted.tag), capture_output=True, text=True, check=False, timeout=60.0
    )
    typer.echo(f"{wanted.tag}: {asked.stdout.strip() or 'size unknown'}")


def _chosen(names: Sequence[str], wheels: bool) -> tuple[OwnImage, ...]:
    unknown = [name for name in names if name not in {image.name for image in OURS}]
    if unknown:
        raise InputError(f"{unknown[0]!r} is none of our images; these are {', '.join(image.name for image in OURS)}")
    if names:
        return tuple(image for image in OURS if image.name in names)
    # All that this machine can build: the router is compiled from sources that only a git host has.
    return tuple(image for image in OURS if image.wheels_stage or not wheels)


def _base(text: str) -> tuple[str, str]:
    name, sign, image = text.partition("=")
    if not sign or name not in {one.name for one in OURS}:
        raise InputError(f"--base: {text[:60]!r}: write NAME=IMAGE, e.g. agent=registry.example/ros:jazzy")
    return name, image


def _revision() -> str:
    """Return the commit that is checked out; `unknown` outside of a repository."""
    asked = subprocess.run(
        ("git", "-C", str(ROOT), "rev-parse", "HEAD"), capture_output=True, text=True, check=False, timeout=60.0
    )
    return asked.stdout.strip() if asked.returncode == 0 else "unknown"


def main() -> None:
    """Run `build` as a program; our own errors end as lines and an exit code."""
    app = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False)
    app.command()(build)
    try:
        app()
    except RobotOffloadError as error:
        for line in error.lines:
            typer.echo(line, err=True)
        raise SystemExit(error.exit_code) from error


if __name__ == "__main__":
    main()
