"""Shared by all commands: how errors end a command, and how its examples are shown."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import typer
from typer._completion_classes import completion_init
from typer.core import TyperGroup

from robot_offload.errors import RobotOffloadError

PROGRAM: Final = "robot-offload"
COMPLETE_VARIABLE: Final = "_ROBOT_OFFLOAD_COMPLETE"
"""Set by the shell while it asks for completions."""


class Commands(TyperGroup):
    """A group of commands that reports its own errors as lines on standard error and an exit code, not a traceback.

    Exit codes: 0 all is well, 1 something ran and a promise was broken, 2 the input is wrong and nothing ran.
    """

    def main(self, *args: Any, **extra: Any) -> Any:
        """Make the shells with completion known, then run the command line."""
        completion_init()
        return super().main(*args, **{"complete_var": COMPLETE_VARIABLE, **extra})

    def invoke(self, ctx: Any) -> Any:
        """Run the chosen command."""
        try:
            return super().invoke(ctx)
        except RobotOffloadError as error:
            for line in error.lines:
                typer.echo(line, err=True)
            raise typer.Exit(error.exit_code) from error


class CommandsWithDefault(Commands):
    """A group that runs its command `default` unless one of its commands follows."""

    default = "file"

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Put the default command in front of a bare argument."""
        if args and args[0] not in self.commands and args[0] not in {"--help", "-h"}:
            args = [self.default, *args]
        return super().parse_args(ctx, args)


def commands(text: str, examples: Sequence[str] = (), cls: type[Commands] = Commands) -> typer.Typer:
    """Return an empty group of commands.

    Args:
        text: beginning of its `--help`.
        examples: command lines shown in its `--help`.
        cls: how it finds the chosen command.
    """
    return typer.Typer(
        cls=cls,
        help=text,
        epilog=example_text(examples),
        no_args_is_help=True,
        add_completion=False,
        rich_markup_mode=None,
        pretty_exceptions_enable=False,
    )


def example_text(examples: Sequence[str]) -> str | None:
    """Return command lines for the end of a help text, one a line."""
    return "\n".join(["\b", "Examples:", *(f"  {example}" for example in examples)]) if examples else None
