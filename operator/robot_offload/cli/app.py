"""What all commands share: how errors end a command, and how its examples are shown."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import typer
from typer.core import TyperGroup

from robot_offload.errors import RobotOffloadError


class Commands(TyperGroup):
    """A group of commands whose own errors end as lines on standard error and an exit code, never as a traceback.

    Exit codes: 0 all is well, 1 something ran and a promise was broken, 2 the input is wrong and nothing ran.
    """

    def invoke(self, ctx: Any) -> Any:
        """Runs the chosen command."""
        try:
            return super().invoke(ctx)
        except RobotOffloadError as error:
            for line in error.lines:
                typer.echo(line, err=True)
            raise typer.Exit(error.exit_code) from error


def commands(text: str, examples: Sequence[str] = ()) -> typer.Typer:
    """An empty group of commands.

    Args:
        text: what its `--help` says first.
        examples: command lines that its `--help` shows.
    """
    return typer.Typer(
        cls=Commands,
        help=text,
        epilog=example_text(examples),
        no_args_is_help=True,
        add_completion=False,
        rich_markup_mode=None,
        pretty_exceptions_enable=False,
    )


def example_text(examples: Sequence[str]) -> str | None:
    """Command lines as the end of a help text, each on its own line (a backspace keeps them from being joined)."""
    return "\n".join(["\b", "Examples:", *(f"  {example}" for example in examples)]) if examples else None
