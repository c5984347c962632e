"""Builds images with docker, podman or buildah: which one is available, and its command line."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Literal, TypeAlias

from robot_offload.api.v1alpha1.build_values import shown
from robot_offload.api.v1alpha1.names import IMAGE_PATTERN
from robot_offload.errors import InputError, RobotOffloadError

Tool: TypeAlias = Literal["docker", "podman", "buildah"]
Command: TypeAlias = tuple[str, ...]

TOOLS: Final[tuple[Tool, ...]] = ("docker", "podman", "buildah")
LOOKUP_TIMEOUT_S: Final = 60.0
_PLATFORM: Final = r"[a-z0-9]+/[a-z0-9]+(/v[0-9]+)?"


class BuildError(RobotOffloadError):
    """A builder ran and failed; its own output has the reason."""


class NoBuilderError(InputError):
    """No program that can build an image is installed."""


@dataclass(frozen=True, slots=True)
class Request:
    """One image to build.

    Attributes:
        tag: its name.
        context: the folder from which the Dockerfile copies.
        platforms: e.g. `linux/arm64`; empty: this machine's own.
        push: whether to push it to its registry.
        health_check: whether it has one; only images in docker's format carry it.
        dockerfile: a file, or `-` for standard input.
        ignore_file: the ignore file of the context; None: `.dockerignore` there. docker finds one beside the
            Dockerfile by itself.
        build_arguments: values of ARG instructions.
        source_date_epoch: seconds since 1970 that replace all times in the image; None: the real times.
        extra: further arguments of the builder, as they are (secrets, caches, volumes).
    """

    tag: str
    context: Path
    platforms: tuple[str, ...] = ()
    push: bool = False
    health_check: bool = False
    dockerfile: str = "-"
    ignore_file: Path | None = None
    build_arguments: Mapping[str, str] = field(default_factory=dict)
    source_date_epoch: int | None = None
    extra: tuple[str, ...] = ()


def commands(tool: Tool, request: Request) -> tuple[Command, ...]:
    """Return the commands, in order: the build, and the push if the builder does not do it at once.

    Raises:
        InputError: the tag or a platform is not valid, or docker would have to keep an image for several platforms
            outside of a registry.
    """
    several = len(request.platforms) > 1
    if tool == "docker" and several and not request.push:
        raise InputError("--platform: docker keeps an image for several platforms in a registry only; add --push")
    if not re.fullmatch(IMAGE_PATTERN, request.tag):
        raise InputError(f"--tag: {shown(request.tag)} is not an image's name; write registry/name:tag, in lower case")
    for platform in request.platforms:
        if not re.fullmatch(_PLATFORM, platform):
            raise InputError(f"--platform: {shown(platform)} is not a platform; write e.g. linux/arm64")
    head: Command = {
        "docker": ("docker", "buildx", "build") if several else ("docker", "build"),
        "podman": ("podman", "build", "--layers"),
        "buildah": ("buildah", "build", "--layers"),
    }[tool]
    name = ("--manifest", request.tag) if several and tool != "docker" else ("--tag", request.tag)
    build = (*head, *name, "--file", request.dockerfile, *_options(tool, request), *request.extra, str(request.context))
    if not request.push:
        return (build,)
    if not several:
        return (build, (tool, "push", request.tag))
    if tool == "docker":
        return ((*build[:-1], "--push", build[-1]),)
    return (build, (tool, "manifest", "push", "--all", request.tag, f"docker://{request.tag}"))


def _options(tool: Tool, request: Request) -> Command:
    options: list[str] = []
    if request.platforms:
        options += ["--platform", ",".join(request.platforms)]
    if request.ignore_file and tool != "docker":
        options += ["--ignorefile", str(request.ignore_file)]
    if request.health_check and tool != "docker":
        options += ["--format", "docker"]
    for name, value in request.build_arguments.items():
        options += ["--build-arg", f"{name}={value}"]
    if request.source_date_epoch is not None:
        epoch = str(request.source_date_epoch)
        options += ["--build-arg", f"SOURCE_DATE_EPOCH={epoch}"] if tool == "docker" else ["--timestamp", epoch]
    return tuple(options)


def source_date_epoch(environment: Mapping[str, str]) -> int | None:
    """Read the time for the image from an environment, see `Request`.

    Raises:
        InputError: it is not a number.
    """
    text = environment.get("SOURCE_DATE_EPOCH", "")
    if not text:
        return None
    if not (text.isascii() and text.isdigit()):
        raise InputError(f"SOURCE_DATE_EPOCH: {text[:40]!r} is not a number of seconds since 1970")
    return int(text)


def choose(wanted: Tool | None = None) -> Tool:
    """Return the builder to use: the wanted one, else the first one that works here.

    Raises:
        NoBuilderError: it is missing, or all are.
    """
    candidates = (wanted,) if wanted else TOOLS
    reasons = []
    for tool in candidates:
        reason = _missing(tool)
        if reason is None:
            return tool
        reasons.append(f"{tool}: {reason}")
    raise NoBuilderError("no builder can be used here; install docker, podman or buildah\n" + "\n".join(reasons))


def _missing(tool: Tool) -> str | None:
    """Return why a builder cannot be used, or None."""
    if shutil.which(tool) is None:
        return "is not installed"
    if tool != "docker":
        return None
    # The client alone cannot build.
    asked = subprocess.run(
        ("docker", "version", "--format", "{{.Server.Version}}"),
        capture_output=True,
        text=True,
        check=False,
        timeout=LOOKUP_TIMEOUT_S,
    )
    return None if asked.returncode == 0 else "its daemon does not answer; start it, or use podman or buildah"


def run(
    tool: Tool, request: Request, dockerfile: str | None = None, environment: Mapping[str, str] | None = None
) -> None:
    """Build, and push if requested; the builder's own progress goes to the terminal.

    Args:
        tool: the builder.
        request: the image to build.
        dockerfile: the text, if `request.dockerfile` is `-`.
        environment: of the builder; None: this process's own.

    Raises:
        BuildError: the builder failed.
        InputError: docker with several platforms, see `commands`.
    """
    for index, command in enumerate(commands(tool, request)):
        text = dockerfile if index == 0 else None
        done = subprocess.run(command, input=text, text=True, check=False, env=environment)
        if done.returncode != 0:
            what = "build" if index == 0 else "push"
            raise BuildError(
                f"{tool} could not {what} {request.tag} (it ended with {done.returncode}); the last lines above say "
                "why, and --dry-run prints the Dockerfile"
            )


def look_up_commit(url: str, ref: str) -> str:
    """Return the commit to which a branch or a tag points now.

    Raises:
        BuildError: the repository does not answer.
        InputError: it has no such branch or tag.
    """
    asked = subprocess.run(
        ("git", "ls-remote", "--", url, ref, f"{ref}^{{}}"),
        capture_output=True,
        text=True,
        check=False,
        timeout=LOOKUP_TIMEOUT_S,
        env=_quiet_git(),
    )
    if asked.returncode != 0:
        reason = (asked.stderr.strip().splitlines() or ["git gives no reason"])[-1]
        raise BuildError(f"{url}: the repository cannot be asked: {reason}")
    found: dict[str, str] = {
        name: commit for commit, name in re.findall(r"^([0-9a-f]{40})\t(.+)$", asked.stdout, re.MULTILINE)
    }
    # An annotated tag points to a commit; `^{}` is that commit.
    for name in (f"refs/tags/{ref}^{{}}", f"refs/heads/{ref}", f"refs/tags/{ref}", ref):
        if name in found:
            return found[name]
    raise InputError(f"--ref: {url} has no branch or tag {ref}")


def _quiet_git() -> dict[str, str]:
    """Return this environment, with git failing instead of asking for a password."""
    return os.environ | {"GIT_TERMINAL_PROMPT": "0"}
