"""`robot-offload completion`: the shell completes commands, options and their values."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Final

import typer
from typer._completion_shared import get_completion_script

from robot_offload.cli.app import COMPLETE_VARIABLE, PROGRAM, example_text

EXAMPLES = (
    "source <(robot-offload completion bash)",
    "robot-offload completion zsh > ~/.zfunc/_robot-offload",
    "robot-offload completion fish > ~/.config/fish/completions/robot-offload.fish",
    "robot-offload completion kubectl > ~/.local/bin/kubectl_complete-offload",
    "chmod +x ~/.local/bin/kubectl_complete-offload",
)
KUBECTL_SCRIPT: Final = f"""\
#!/bin/sh
# kubectl runs this to complete the words behind `kubectl offload`; the last of them is the unfinished one.
COMP_WORDS="{PROGRAM} $*" COMP_CWORD=$# {COMPLETE_VARIABLE}=complete_bash {PROGRAM}
echo ":4" # tells kubectl that files are no answer
"""


class Shell(StrEnum):
    """The supported shells, and kubectl, which calls its plugins for completions."""

    BASH = "bash"
    ZSH = "zsh"
    FISH = "fish"
    KUBECTL = "kubectl"


def add_to(app: typer.Typer) -> None:
    """Add the command to `app`."""
    app.command("completion", epilog=example_text(EXAMPLES))(completion)


def completion(
    shell: Annotated[Shell, typer.Argument(metavar="bash|zsh|fish|kubectl", help="Your shell, or kubectl.")],
) -> None:
    """Print a script that makes the shell complete `robot-offload`.

    With kubectl it is a program that makes `kubectl offload` complete in every shell where kubectl itself does: put it
    on the PATH as kubectl_complete-offload.
    """
    if shell is Shell.KUBECTL:
        typer.echo(KUBECTL_SCRIPT, nl=False)
        return
    typer.echo(get_completion_script(prog_name=PROGRAM, complete_var=COMPLETE_VARIABLE, shell=shell.value))
