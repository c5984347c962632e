"""`robot-offload completion`: the shell completes commands, options and their values."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer
from typer._completion_shared import get_completion_script

from robot_offload.cli.app import COMPLETE_VARIABLE, PROGRAM, example_text

EXAMPLES = (
    "source <(robot-offload completion bash)",
    "robot-offload completion zsh > ~/.zfunc/_robot-offload",
    "robot-offload completion fish > ~/.config/fish/completions/robot-offload.fish",
)


class Shell(StrEnum):
    """The shells that are known."""

    BASH = "bash"
    ZSH = "zsh"
    FISH = "fish"


def add_to(app: typer.Typer) -> None:
    """Adds the command to `app`."""
    app.command("completion", epilog=example_text(EXAMPLES))(completion)


def completion(shell: Annotated[Shell, typer.Argument(metavar="bash|zsh|fish", help="Your shell.")]) -> None:
    """Print a script that makes the shell complete `robot-offload`."""
    typer.echo(get_completion_script(prog_name=PROGRAM, complete_var=COMPLETE_VARIABLE, shell=shell.value))
