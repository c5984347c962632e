"""The files for k9s (docs/how-to/k9s): commands that the plugin has, columns that the server prints."""

from pathlib import Path
from typing import Any

import pytest
import yaml
from typer.testing import CliRunner

from robot_offload.cli.main import app

ROOT = Path(__file__).parents[3]
FOLDER = ROOT / "docs" / "how-to" / "k9s"
ALWAYS = {"NAMESPACE", "NAME", "AGE"}
VARIABLES = {"$NAME": "talker", "$NAMESPACE": "ward", "$CONTEXT": "test"}
"""What k9s fills in."""


def plugins() -> dict[str, Any]:
    """The plugins by name."""
    found: dict[str, Any] = yaml.safe_load((FOLDER / "plugins.yaml").read_text())["plugins"]
    return found


def definition() -> dict[str, Any]:
    """The definition of RobotOffloads."""
    objects = yaml.safe_load_all((ROOT / "manifests" / "crd" / "robotoffloads.robotoffload.dev.yaml").read_text())
    found: dict[str, Any] = next(
        one["spec"] for one in objects if one and one["kind"] == "CustomResourceDefinition"
        and one["spec"]["names"]["kind"] == "RobotOffload"
    )  # fmt: skip
    return found


@pytest.mark.parametrize("name", plugins())
def test_a_plugin_calls_a_command_that_there_is(name: str) -> None:
    plugin = plugins()[name]
    assert plugin["scopes"] == [definition()["names"]["plural"]]
    words = plugin["args"][1].replace('"', "").partition("|")[0].split() if plugin["command"] == "bash" else None
    given = [VARIABLES.get(word, word) for word in words or ["kubectl", *plugin["args"]]]
    if words is None:
        assert plugin["command"] == "kubectl"
        assert plugin["confirm"], "a pin is asked about"
    assert given[:2] == ["kubectl", "offload"]
    done = CliRunner().invoke(app, [*given[2:], "--help"])
    assert done.exit_code == 0, done.output
    options = {word for word in given if word.startswith("--")}
    assert options <= set(done.stdout.split()), "k9s's options are options of the command"


def test_shortcuts_are_used_once() -> None:
    keys = [plugin["shortCut"] for plugin in plugins().values()]
    assert len(set(keys)) == len(keys)


def test_every_column_of_the_view_is_printed_by_the_server() -> None:
    spec = definition()
    [(name, view)] = yaml.safe_load((FOLDER / "views.yaml").read_text())["views"].items()
    [version] = [one for one in spec["versions"] if one["name"] == name.split("/")[1]]
    assert name == f"{spec['group']}/{version['name']}/{spec['names']['plural']}"
    printed = {column["name"].upper() for column in version["additionalPrinterColumns"]}
    columns = {column.partition("|")[0] for column in view["columns"]}
    assert columns <= printed | ALWAYS
    assert view["sortColumn"].partition(":")[0] in columns
