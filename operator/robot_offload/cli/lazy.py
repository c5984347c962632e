"""Commands that are imported when they are used, so that a command line loads only what it needs."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import typer
from typer.core import TyperCommand

from robot_offload.cli import lab
from robot_offload.cli.app import Commands, commands
from robot_offload.errors import InputError

ROOM: Final = "robot_offload.cli"
EXTRAS: Final = {
    "kubernetes": "cluster",
    "aiohttp": "cluster",
    "prometheus_client": "operator",
    "structlog": "operator",
    "nicegui": "console",
    "fastapi": "console",
    "starlette": "console",
    "uvicorn": "console",
}
"""The extra that installs each library that the command line itself does not need."""
NEEDS: Final = {
    "cluster": "talks to a cluster",
    "operator": "talks to a cluster",
    "console": "serves pages to a browser",
}
"""Why a command needs an extra."""


@dataclass(frozen=True, slots=True)
class Entry:
    """One command of the first page.

    Attributes:
        name: what is typed.
        module: where its `add_to(app)` is, below `robot_offload.cli`; empty: in the lab.
        help: the first sentence of its own help.
        hidden: whether the first page omits it.
    """

    name: str
    module: str
    help: str
    hidden: bool = False


class LazyCommand(TyperCommand):
    """A placeholder for a command on the first page and in completions, until it is chosen."""

    def __init__(self, entry: Entry) -> None:
        super().__init__(entry.name, help=entry.help, hidden=entry.hidden)
        self._entry = entry

    def load(self) -> Any:
        """Import the command itself.

        Raises:
            InputError: the command needs an extra that is not installed.
        """
        entry, app = self._entry, commands("")
        if entry.module:
            try:
                importlib.import_module(f"{ROOM}.{entry.module}").add_to(app)
            except ModuleNotFoundError as error:
                raise without_extra(entry.name, error) from error
        else:
            lab.add_to(app, entry.name)
        return typer.main.get_group(app).commands[entry.name]


class LazyCommands(Commands):
    """A group that shows its commands from a table and imports only the chosen one."""

    entries: Sequence[Entry] = ()

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        self.commands = {entry.name: LazyCommand(entry) for entry in self.entries}

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        """Find the chosen command and import it."""
        name, command, rest = super().resolve_command(ctx, args)
        return name, command.load() if isinstance(command, LazyCommand) else command, rest


def without_extra(command: str, error: ModuleNotFoundError) -> Exception:
    """Return what to raise for a missing library: the next step if an extra installs it, else the error itself."""
    extra = EXTRAS.get((error.name or "").partition(".")[0])
    if extra is None:
        return error
    return InputError(f"robot-offload {command} {NEEDS[extra]}: pip install 'robot-offload[{extra}]'")
