"""The demo's own options; nothing is started."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from robot_offload.cli.main import app
from robot_offload_lab.cli import demo

ROOT = Path(__file__).parents[4]


def test_without_a_specification_the_wheelchair_of_the_repository_drives_from_any_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert demo._found(None) == ROOT / demo.WHEELCHAIR


def test_an_installed_package_without_a_repository_says_where_the_example_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(demo, "__file__", str(tmp_path / "site-packages" / "robot_offload_lab" / "cli" / "demo.py"))
    ended = CliRunner().invoke(app, ["demo"])
    assert ended.exit_code == 2
    assert "in the repository and not in the installed package" in str(ended.exception or "") + ended.output
