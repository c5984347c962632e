"""The demo's own options; nothing is started."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from robot_offload.cli.main import app
from robot_offload.errors import InputError
from robot_offload_lab.cli import demo

ROOT = Path(__file__).parents[4]


def test_without_a_specification_the_wheelchair_of_the_repository_drives_from_any_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert demo._found(None) == ROOT / "examples/wheelchair/robotoffload.yaml"


def test_an_installed_package_without_a_repository_says_where_the_example_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(demo, "__file__", str(tmp_path / "site-packages" / "robot_offload_lab" / "cli" / "demo.py"))
    ended = CliRunner().invoke(app, ["demo"])
    assert ended.exit_code == 2
    assert "in the repository and not in the installed package" in str(ended.exception or "") + ended.output


def test_an_example_is_found_by_its_name_and_an_unknown_one_lists_those_that_are_there() -> None:
    assert demo._found(None, "talker") == ROOT / "examples/talker/robotoffload.yaml"
    with pytest.raises(InputError, match=r"'walker' is not one of .*talker, wheelchair"):
        demo._found(None, "walker")
    with pytest.raises(InputError, match="name one of the two"):
        demo._found(Path("a.yaml"), "talker")
