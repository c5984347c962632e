"""`robot-offload import` without a graph: from a file, its program, and what it says when something is missing."""

import ast
import json
import subprocess
from pathlib import Path

import pytest
from typer.testing import CliRunner

from robot_offload.api.files import load
from robot_offload.cli.main import app
from robot_offload.survey import asked
from tests.unit.operator.survey.graphs import small

SEEN = Path(__file__).resolve().parents[1] / "survey" / "wheelchair.json"


def run(*words: str) -> tuple[int, str, str]:
    done = CliRunner().invoke(app, ["import", *words])
    return done.exit_code, done.stdout, done.stderr


def test_a_kept_graph_becomes_a_valid_file_and_the_next_step_is_said(tmp_path: Path) -> None:
    file = tmp_path / "robot.yaml"
    code, said, _ = run("--from", str(SEEN), "--name", "walker", "-o", str(file))
    assert code == 0
    assert load(file).metadata.name == "walker"
    assert f"{file}: 4 of 4 nodes; leave the robot: controller, localiser" in said
    assert f"robot-offload validate {file}" in said


def test_a_file_that_is_there_stays(tmp_path: Path) -> None:
    file = tmp_path / "robot.yaml"
    file.write_text("mine")
    code, _, problem = run("--from", str(SEEN), "-o", str(file))
    assert (code, file.read_text()) == (2, "mine")
    assert "--force" in problem
    assert run("--from", str(SEEN), "-o", str(file), "--force")[0] == 0


def test_json_is_the_same_resource_without_comments(tmp_path: Path) -> None:
    code, said, _ = run("--from", str(SEEN), "--json")
    assert code == 0
    assert json.loads(said)["spec"]["driver"] == {"inhibitService": "/wheels_control/inhibit"}


def test_a_graph_is_kept_and_read_again(tmp_path: Path) -> None:
    kept = tmp_path / "graph.json"
    first = run("--from", str(SEEN), "--snapshot", str(kept))[1]
    assert run("--from", str(kept))[1] == first


@pytest.mark.parametrize(
    "text", ["", "[]", "{", '{"version": 2}', '{"nodes": [{}]}', '{"topics": [{"name": 3}]}', "\0"]
)
def test_what_is_no_graph_is_refused_in_one_line(text: str, tmp_path: Path) -> None:
    file = tmp_path / "graph.json"
    file.write_text(text)
    code, _, problem = run("--from", str(file))
    assert code == 2
    assert problem.startswith(f"{file}: no graph of `robot-offload import --snapshot`")
    assert len(problem.splitlines()) == 1


def test_an_empty_graph_ends_with_1_and_says_where_to_look(tmp_path: Path) -> None:
    file = tmp_path / "graph.json"
    file.write_text(small().model_copy(update={"nodes": ()}).model_dump_json())
    code, _, problem = run("--from", str(file))
    assert code == 1
    assert "ROS_DOMAIN_ID and RMW_IMPLEMENTATION" in problem


def test_the_program_for_the_robot_needs_ros_and_nothing_of_ours() -> None:
    code, said, _ = run("--program")
    assert code == 0
    imported = {
        (it.module if isinstance(it, ast.ImportFrom) else it.names[0].name).partition(".")[0]
        for it in ast.walk(ast.parse(said, feature_version=(3, 10)))
        if isinstance(it, ast.Import | ast.ImportFrom) and (isinstance(it, ast.Import) or it.module)
    }
    assert "robot_offload" not in imported
    assert imported - {"rclpy"} <= {"__future__", "collections", "importlib", "itertools", "json", "os", "pathlib",
                                    "platform", "sys", "time", "typing"}  # fmt: skip


def test_without_rclpy_the_next_step_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    monkeypatch.setattr("shutil.which", lambda name: None)
    code, _, problem = run()
    assert code == 2
    assert "source /opt/ros/DISTRO/setup.bash" in problem
    assert "--program" in problem


def test_a_look_that_fails_says_the_last_line_of_its_reason(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    program = tmp_path / "look.py"
    program.write_text("raise RuntimeError('the middleware is not there')")
    monkeypatch.setattr(asked, "PROGRAM", program)
    code, _, problem = run()
    assert code == 1
    assert "the middleware is not there" in problem


def test_a_look_that_hangs_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    def hang(*_: object, **__: object) -> None:
        raise subprocess.TimeoutExpired("look", 1)

    monkeypatch.setattr(asked, "interpreter", lambda: "python3")
    monkeypatch.setattr("subprocess.run", hang)
    code, _, problem = run()
    assert code == 1
    assert "did not answer within" in problem
