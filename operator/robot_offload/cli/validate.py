"""`robot-offload validate`: every problem of a specification at once, before anything starts."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from robot_offload.api.v1alpha1.checks import check
from robot_offload.cli.app import example_text
from robot_offload.errors import InputError, SpecError
from robot_offload.findings import Finding
from robot_offload.loading import load

EXAMPLES = (
    "robot-offload validate examples/wheelchair/robotoffload.yaml",
    "robot-offload validate wheelchair.yaml --json | jq -r '.problems[].path'",
)


def add_to(app: typer.Typer) -> None:
    """Adds the command to `app`."""
    app.command("validate", epilog=example_text(EXAMPLES))(validate)


def validate(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="YAML file with one RobotOffload.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as JSON on standard output.")] = False,
) -> None:
    """Check a RobotOffload file and tell every problem.

    Each problem is one line, `file: field: what to do`. Ends with 0 when the file can be used (warnings are only
    told) and with 2 when it cannot.
    """
    try:
        offload = load(file)
    except SpecError as error:
        if as_json:
            _print_json(file, error.findings)
            raise typer.Exit(InputError.exit_code) from error
        raise
    warnings = check(offload.spec)
    if as_json:
        _print_json(file, warnings)
        return
    for finding in warnings:
        typer.echo(f"{file}: warning: {finding.line()}", err=True)
    nodes, collected = len(offload.spec.nodes), len(offload.spec.collected_outputs)
    typer.echo(f"{file}: {offload.metadata.name} is valid, nodes: {nodes}, collected outputs: {collected}")


def _print_json(file: Path, findings: Sequence[Finding]) -> None:
    valid = all(finding.severity == "warning" for finding in findings)
    problems = [dataclasses.asdict(finding) for finding in findings]
    typer.echo(json.dumps({"file": str(file), "valid": valid, "problems": problems}, indent=2))
