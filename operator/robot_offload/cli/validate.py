"""`robot-offload validate`: report every problem of specifications at once, before anything starts."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from typing import Annotated

import typer

from robot_offload.api.strict_yaml import YamlError, parse
from robot_offload.api.v1alpha1 import RobotOffload, pinned
from robot_offload.api.v1alpha1.parsing import items, parse_object
from robot_offload.api.v1alpha1.rules import CHECKS, CLUSTER_CHECKS, Check, check
from robot_offload.cli.app import example_text
from robot_offload.cli.sources import Source, sources
from robot_offload.errors import InputError, SpecError
from robot_offload.findings import Finding

EXAMPLES = (
    "robot-offload validate examples/wheelchair/robotoffload.yaml",
    "robot-offload validate --cluster manifests/samples",
    "kubectl get roff wheelchair -o yaml | kubectl offload validate -",
    "robot-offload validate wheelchair.yaml --json | jq -r '.files[].problems[].path'",
)


def add_to(app: typer.Typer) -> None:
    """Add the command to `app`."""
    app.command("validate", epilog=example_text(EXAMPLES))(validate)


@dataclasses.dataclass(frozen=True, slots=True)
class Verdict:
    """The result for one source.

    Attributes:
        source: its name.
        offload: the RobotOffload in it; None: it cannot be used.
        findings: errors, or the warnings of a usable source.
    """

    source: str
    offload: RobotOffload | None
    findings: tuple[Finding, ...]


def validate(
    files: Annotated[
        list[str],
        typer.Argument(
            metavar="FILE...", help="YAML files with one RobotOffload or a list of them each, folders of them, or - ."
        ),
    ],
    *,
    cluster: Annotated[
        bool, typer.Option("--cluster", help="Also what a cluster needs and a run on one machine does not.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as JSON on standard output.")] = False,
) -> None:
    """Check RobotOffload files and report every problem.

    Each problem is one line, `file: field: what to do`. Ends with 0 when all files can be used (warnings are only
    told) and with 2 when one cannot. Nothing is sent to a cluster.
    """
    rules = CLUSTER_CHECKS if cluster else CHECKS
    verdicts = [verdict for source in sources(files) for verdict in judge(source, rules)]
    if as_json:
        _print_json(verdicts)
    else:
        for verdict in verdicts:
            _print(verdict)
    if any(verdict.offload is None for verdict in verdicts):
        raise typer.Exit(InputError.exit_code)


def judge(source: Source, rules: Sequence[Check]) -> tuple[Verdict, ...]:
    """Return a verdict about each object of one source."""
    try:
        value = parse(source.text)
    except YamlError as error:
        return (Verdict(source.name, None, (Finding(error.position, "NotYaml", error.problem),)),)
    listed = items(value)
    if listed is None:
        return (_judge(value, source.name, rules),)
    if not listed:
        return (Verdict(source.name, None, (Finding("items", "TooShort", "the list holds no object"),)),)
    return tuple(_judge(item, f"{source.name}: items[{i}]", rules) for i, item in enumerate(listed))


def _judge(value: object, name: str, rules: Sequence[Check]) -> Verdict:
    try:
        offload = parse_object(value, name, rules=rules)
    except SpecError as error:
        return Verdict(name, None, error.findings)
    return Verdict(name, offload, (*check(offload.spec, rules), *pinned.findings(offload)))


def _print(verdict: Verdict) -> None:
    for finding in verdict.findings:
        kind = "warning: " if finding.severity == "warning" else ""
        typer.echo(f"{verdict.source}: {kind}{finding.line()}", err=True)
    if verdict.offload is not None:
        spec, name = verdict.offload.spec, verdict.offload.metadata.name
        nodes, collected = len(spec.nodes), len(spec.collected_outputs)
        typer.echo(f"{verdict.source}: {name} is valid, nodes: {nodes}, collected outputs: {collected}")


def _print_json(verdicts: Sequence[Verdict]) -> None:
    files = [
        {
            "file": verdict.source,
            "valid": verdict.offload is not None,
            "problems": [dataclasses.asdict(finding) for finding in verdict.findings],
        }
        for verdict in verdicts
    ]
    typer.echo(json.dumps({"valid": all(file["valid"] for file in files), "files": files}, indent=2))
