"""`robot-offload bench`: the measurements of `robot_offload_lab.bench` under the product's own command."""

from __future__ import annotations

import typer

from robot_offload_lab.bench import main


def add_to(app: typer.Typer) -> None:
    """Add the commands to `app`."""
    app.add_typer(main.app, name="bench")
