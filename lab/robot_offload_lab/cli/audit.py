"""`robot-offload audit`: the audit trail of a robot, checked and printed away from the robot."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from robot_offload.cli.app import example_text
from robot_offload.errors import InputError
from robot_offload_core.record import audit

EXAMPLES = (
    "robot-offload audit verify /var/lib/robot-offload/NAME/audit",
    "robot-offload audit verify audit --head 41:5b1f...",
    "robot-offload audit export audit > audit.json",
)

app = typer.Typer(
    help="Check the audit trail of a robot: pins, switches by hand, settings, certificates.",
    epilog=example_text(EXAMPLES), no_args_is_help=True,
)  # fmt: skip

Place = Annotated[Path, typer.Argument(metavar="FOLDER", help="The folder `audit` of a robot's state, or a copy.")]
Seen = Annotated[str, typer.Option("--head", metavar="NUMBER:DIGEST", help="An entry that was seen before.")]


def add_to(parent: typer.Typer) -> None:
    """Add the commands to `parent`."""
    parent.add_typer(app, name="audit")


@app.command("verify")
def verify(place: Place, head: Seen = "") -> None:
    """Check that a trail is one chain, and holds an entry that was seen before.

    Exit code 1: the trail was altered, or another version of the agent wrote a part of it.
    """
    known = audit.parse_head(head) if head else None
    if head and known is None:
        raise InputError("--head: write NUMBER:DIGEST as `audit verify` prints it")
    verdict = audit.verify(_lines(place), known)
    for sentence in audit.sentences(verdict):
        typer.echo(sentence)
    if verdict.problems or verdict.others:
        raise typer.Exit(1)


@app.command("export")
def export(place: Place) -> None:
    """Print the entries as JSON."""
    typer.echo(json.dumps(audit.exported(_lines(place)), indent=1))


def _lines(place: Path) -> list[str]:
    files = sorted(place.glob("audit-*.log")) if place.is_dir() else [place]
    if not files:
        raise InputError(f"{place}: is not an audit trail; name the folder `audit` of a robot's state")
    try:
        texts = [file.read_text(encoding="ascii", errors="replace") for file in files]
    except OSError as error:
        raise InputError(f"{error.filename}: {error.strerror}") from error
    return [line for text in texts for line in text.splitlines(keepends=True)]
