"""The commands as somebody at a terminal meets them; nothing is measured here."""

from __future__ import annotations

import io
import json
import subprocess
import sys
from pathlib import Path

import pytest
from rich.console import Console
from typer.testing import CliRunner, Result

from robot_offload.cli.main import app
from robot_offload_lab.bench import page
from robot_offload_lab.bench.session import BenchSession
from robot_offload_lab.bench.store import Store
from tests.unit.lab.bench.test_results import kept

COMMANDS = ("latency", "lifecycle", "switch", "detect", "collector", "all", "page")


def run(*arguments: str) -> Result:
    return CliRunner().invoke(app, ["bench", *arguments])


def test_the_first_page_names_every_command_and_teaches_with_examples():
    shown = run("--help").stdout
    assert all(f"\n  {command} " in shown for command in COMMANDS)
    assert "Examples:\n" in shown


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_a_page_of_its_own(command: str):
    shown = run(command, "--help")
    assert shown.exit_code == 0
    assert "--out" in shown.stdout


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (("lifecycle", "--domains", "1/1"), "--domains: '1/1': write two different numbers"),
        (("detect", "--case", "cold"), "--case: there is no 'cold'; known are warm, hot"),
        (("latency", "--case", "moon"), "--case: there is no 'moon'; known are one-host, bridge"),
    ],
)
def test_wrong_input_is_told_in_a_line_and_ends_with_2(tmp_path: Path, arguments: tuple[str, ...], line: str):
    ended = run(*arguments, "--out", str(tmp_path))
    assert ended.exit_code == 2
    assert ended.stderr.startswith(line)
    assert not list(tmp_path.iterdir())


def test_a_folder_of_something_else_ends_with_2(tmp_path: Path):
    (tmp_path / "results.json").write_text(json.dumps({"schema": "other"}))
    ended = run("lifecycle", "--out", str(tmp_path))
    assert ended.exit_code == 2
    assert "give another --out" in ended.stderr


def test_the_help_needs_neither_matplotlib_nor_ros():
    code = (
        "import sys; sys.modules['matplotlib'] = sys.modules['rclpy'] = None\n"
        "from typer.testing import CliRunner; from robot_offload.cli.main import app\n"
        "assert CliRunner().invoke(app, ['--help']).exit_code == 0\n"
        "assert CliRunner().invoke(app, ['bench', 'all', '--help']).exit_code == 0\n"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr


def test_without_matplotlib_there_are_tables_and_a_word_about_the_pictures(tmp_path: Path):
    Store(tmp_path).put(kept("commanded", 51.0))
    code = (
        "import sys; sys.modules['matplotlib'] = None\n"
        "from typer.testing import CliRunner; from robot_offload.cli.main import app\n"
        f"ended = CliRunner().invoke(app, ['bench', 'page', '--out', {str(tmp_path)!r}])\n"
        "print(ended.stdout); sys.exit(ended.exit_code)\n"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
    assert "51.0 ms" in ended.stdout
    assert "install matplotlib" in ended.stdout


def test_the_page_can_be_written_again_without_measuring(tmp_path: Path):
    Store(tmp_path / "out").put(kept("commanded", 51.0))
    BenchSession(Console(file=io.StringIO(), width=200), Store(tmp_path / "out"), tmp_path / "docs").show()
    assert "51.0 ms" in (tmp_path / "docs" / page.PAGE).read_text()
