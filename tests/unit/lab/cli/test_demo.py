"""The demo's own options; nothing is started."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from robot_offload.cli.main import app
from robot_offload.errors import InputError
from robot_offload_lab.cli import demo
from robot_offload_lab.judge import report
from robot_offload_lab.judge.measures import measure
from robot_offload_lab.judge.recording import Ending, PathPoint, RecordingWriter, read
from robot_offload_lab.run.demo import DemoOptions, DemoResult
from robot_offload_lab.run.system import Mode
from robot_offload_lab.show.view import View
from tests.unit.lab.judge.recordings import RUN

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


def test_compare_runs_the_three_modes_each_in_a_folder_of_its_own_and_draws_them_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[DemoOptions] = []

    def run(options: DemoOptions, _view: View) -> DemoResult:
        asked.append(options)
        file = tmp_path / f"{options.mode.value}.jsonl"
        with file.open("w") as stream:
            writer = RecordingWriter(stream, replace(RUN, mode=options.mode.value))
            writer.write(PathPoint(RUN.start_s, 0.0, 0.0, 0.5))
            writer.write(PathPoint(RUN.start_s + 2.0, 1.0, 0.0, 0.5))
            writer.write(Ending(RUN.start_s + 10.0, 0, 0, True))
        processor = {"robot-agent": 10.0, "cloud-agent": 5.0}
        said = report.build(measure(read(file)), processor)
        if options.mode is Mode.CLOUD_ONLY:
            said["violations"] = [{"kind": "Gap", "t_s": 1.0, "text": "nobody acted"}]
        return DemoResult(said, file)

    monkeypatch.setattr(demo, "run", run)
    ended = CliRunner().invoke(app, ["demo", "--compare", "--no-ui", "--out", str(tmp_path / "out")])
    assert ended.exit_code == 0, ended.output
    assert [options.mode.value for options in asked] == ["offload", "robot-only", "cloud-only"]
    assert [options.out for options in asked] == [tmp_path / "out" / options.mode.value for options in asked]
    assert {options.longest_s for options in asked} == {demo.COMPARED_S}, "the slower ones come to their end, too"
    assert (tmp_path / "out" / "compare.png").stat().st_size > 10_000
    assert "cloud-only" in ended.output
