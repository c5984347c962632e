"""The commands of the lab (`demo`, `simulate`, `bench`), which has its own package: `robot-offload-lab`."""

from __future__ import annotations

from importlib.metadata import entry_points
from typing import Annotated, Final

import typer

from robot_offload.errors import InputError

GROUP: Final = "robot_offload.commands"
"""The entry-point group in which a package lists the modules of its commands; each has `add_to(app)`."""

_HELP: Final = {
    "demo": "Run both sides on this machine while the link between them fails.",
    "simulate": "Try switching rules on a recorded link, or the protocol in virtual time.",
    "bench": "Measure what the product claims.",
    "blackbox": "Replay what an agent took in and decided: its black box.",
    "audit": "Check the audit trail of a robot: pins, switches by hand, settings, certificates.",
}


def add_to(app: typer.Typer, name: str) -> None:
    """Add the command `name`: the lab's if it is installed, else one that explains how to install it.

    Raises:
        KeyError: `name` is not a command of the lab.
    """
    problem = "which is not installed"
    for found in entry_points(group=GROUP, name=name):
        try:
            found.load().add_to(app)
        except ImportError as error:
            problem = f"which cannot be loaded ({error})"
        else:
            return
    _add_missing(app, name, f"robot-offload {name} is part of the lab, {problem}: pip install robot-offload-lab")


def _add_missing(app: typer.Typer, name: str, message: str) -> None:
    def missing(words: Annotated[list[str] | None, typer.Argument(hidden=True)] = None) -> None:
        raise InputError(message)

    context = {"ignore_unknown_options": True, "allow_extra_args": True}
    app.command(name, help=f"{_HELP[name]} ({message})", context_settings=context, add_help_option=False)(missing)
