"""`python -m robot_offload_lab.bench.see`: what it costs to see what the switch does. Parts measure, this shows.

Nothing here asserts: the table names the aims.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Final

import typer
from rich.console import Console
from rich.table import Table

from robot_offload.errors import InputError
from robot_offload_lab.bench import see_console, see_recording
from robot_offload_lab.bench.see_figures import SeeFigure

Part = Callable[[Path], list[SeeFigure]]
PARTS: Final[Mapping[str, Part]] = {"console": see_console.measure, "recording": see_recording.measure}
"""Each measures one thing, alone on the machine, within some minutes; it gets a folder for its files."""


def main(
    *,
    part: Annotated[list[str] | None, typer.Option(help="Part to measure; more than once. Default: all.")] = None,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for the figures.")] = Path("out/bench-see"),
) -> None:
    """Measure console, recordings and metrics: how late, how much processor time."""
    unknown = set(part or ()) - set(PARTS)
    if unknown:
        raise InputError(f"--part: {', '.join(sorted(unknown))}: write one of {', '.join(PARTS)}")
    out.mkdir(parents=True, exist_ok=True)
    console = Console()
    for name in part or PARTS:
        load = os.getloadavg()[0]
        figures = PARTS[name](out)
        table = Table("figure", "measured", "aim", title=f"{name} (load before: {load:.1f}, {os.cpu_count()} cores)")
        for figure in figures:
            table.add_row(figure.name, figure.text, figure.aim)
        console.print(table)
        values = {"load": load, "cores": os.cpu_count(), "figures": [asdict(figure) for figure in figures]}
        (out / f"{name}.json").write_text(json.dumps(values, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    typer.run(main)
