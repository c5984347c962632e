"""`robot-offload crd`: the custom resource definition, to look at or to apply."""

from __future__ import annotations

import typer
import yaml

from robot_offload.api.crd import crd as definition
from robot_offload.cli.app import example_text

EXAMPLES = ("robot-offload crd | kubectl apply --server-side -f -", "robot-offload crd > robotoffloads.yaml")


def add_to(app: typer.Typer) -> None:
    """Add the command to `app`."""
    app.command("crd", epilog=example_text(EXAMPLES))(crd)


def crd() -> None:
    """Print the CustomResourceDefinition of RobotOffload. The Helm chart installs the same."""
    typer.echo(yaml.safe_dump(definition(), sort_keys=False, width=120), nl=False)
