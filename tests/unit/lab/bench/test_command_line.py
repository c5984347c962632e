"""The command as somebody at a terminal meets it; nothing is measured here."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from robot_offload.cli.main import app
from robot_offload_lab.bench.main import NAMES
from robot_offload_lab.bench.rows import FILE


def run(*arguments: str) -> Result:
    return CliRunner().invoke(app, ["bench", *arguments])


def test_the_help_names_everything_that_can_be_measured_and_teaches_with_examples():
    shown = run("--help").stdout
    assert all(name in shown for name in NAMES)
    assert "Examples:\n" in shown


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (("moon",), "NAME: there is no 'moon'; known are all, switch"),
        (("lifecycle", "--domains", "1/1"), "--domains: '1/1': write two different numbers"),
        (("detect", "--case", "cold"), "--case: there is no 'cold'; known are warm, hot"),
        (("latency", "--case", "moon"), "--case: there is no 'moon'; known are one-host, bridge"),
        (("cuts", "--case", "warm"), "--case: there is no 'warm'; known are none"),
        (("cuts", "--set", "moons=1"), "--set: there is no amount 'moons'; known are switches, cuts"),
        (("cuts", "--set", "cuts=many"), "--set: 'cuts=many' is not valid; write for example cuts=4"),
        (("cuts", "--set", "cuts=0"), "--set: 'cuts=0' is not valid"),
        (("cuts", "--set", "cuts"), "--set: 'cuts' is not valid"),
    ],
)
def test_wrong_input_is_told_in_a_line_and_ends_with_2(tmp_path: Path, arguments: tuple[str, ...], line: str):
    ended = run(*arguments, "--out", str(tmp_path))
    assert ended.exit_code == 2
    assert ended.stderr.startswith(line)
    assert not list(tmp_path.iterdir())


def test_a_folder_of_something_else_ends_with_2(tmp_path: Path):
    (tmp_path / FILE).write_text("a,b\n")
    ended = run("lifecycle", "--out", str(tmp_path))
    assert ended.exit_code == 2
    assert "name another folder" in ended.stderr


def test_the_help_needs_neither_matplotlib_nor_ros():
    code = (
        "import sys; sys.modules['matplotlib'] = sys.modules['rclpy'] = None\n"
        "from typer.testing import CliRunner; from robot_offload.cli.main import app\n"
        "assert CliRunner().invoke(app, ['--help']).exit_code == 0\n"
        "assert CliRunner().invoke(app, ['bench', '--help']).exit_code == 0\n"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
