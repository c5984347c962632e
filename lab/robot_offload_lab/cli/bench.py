"""`robot-offload bench`: the measurements of `robot_offload_lab.bench` under the product's own command."""

from __future__ import annotations

import typer

from robot_offload.cli.app import example_text
from robot_offload_lab.bench.main import EXAMPLES, bench


def add_to(app: typer.Typer) -> None:
    """Add the command to `app`."""
    app.command("bench", epilog=example_text(EXAMPLES))(bench)
