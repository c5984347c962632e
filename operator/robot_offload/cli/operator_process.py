"""`robot-offload operator`: the operator's own process. Hidden, because only the chart starts it."""

from __future__ import annotations

import importlib

import typer


def add_to(app: typer.Typer) -> None:
    """Add the command to `app`."""
    app.command("operator", hidden=True)(operator)


def operator() -> None:
    """Run the operator until it is told to stop."""
    # Imported only here: its framework takes a second to load, and no other command needs it.
    raise typer.Exit(importlib.import_module("robot_offload.handlers").main())
