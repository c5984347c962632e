"""The `build:` block of a RobotOffload on the command line: Dockerfile, rendering, and how it is shown."""

from __future__ import annotations

import datetime
from pathlib import Path

import pytest
import yaml
from rich.console import Console
from typer.testing import CliRunner, Result

from robot_offload.cli import render
from robot_offload.cli.app import commands
from robot_offload.cli.cluster import Live
from robot_offload.cli.images import build, dockerfile
from robot_offload.cli.status import show
from robot_offload.insight.explanation import explain
from robot_offload.insight.observed import observe

SAMPLE = Path(__file__).parents[4] / "manifests" / "samples" / "built.yaml"
NOW = datetime.datetime(2026, 11, 22, tzinfo=datetime.UTC)


def run(*arguments: str) -> Result:
    app = commands("Images.")
    for command in (dockerfile, build, render):
        command.add_to(app)
    return CliRunner().invoke(app, list(arguments))


def test_the_dockerfile_of_a_node_is_that_of_the_same_options() -> None:
    by_options = run(
        "dockerfile", "--git", "https://git.example/robot.git", "--ref", "v1.2.0", "--path", "src/controller",
        "--path", "src/interfaces", "--package", "controller", "--executable", "controller_server",
        "--apt-package", "libyaml-cpp-dev", "--label", "org.opencontainers.image.source=https://git.example/robot.git",
    )  # fmt: skip
    of_node = run("dockerfile", str(SAMPLE), "--node", "controller")
    assert (of_node.exit_code, of_node.stdout) == (0, by_options.stdout)
    assert run("dockerfile", str(SAMPLE)).stdout == of_node.stdout


def test_options_win_over_the_block() -> None:
    assert "ros:kilted" in run("dockerfile", str(SAMPLE), "--distro", "kilted").stdout


def test_the_same_image_can_be_built_on_this_machine() -> None:
    done = run("build", str(SAMPLE), "--tag", "a:1", "--builder", "buildah", "--dry-run")
    assert (done.exit_code, done.stdout.splitlines()[0]) == (0, run("dockerfile", str(SAMPLE)).stdout.splitlines()[0])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((str(SAMPLE), "--node", "planner"), "no node 'planner' with a build block; it has controller"),
        ((str(SAMPLE.with_name("talker.yaml")),), "no node has a build block"),
        ((str(SAMPLE), "--agent"), "goes with neither --agent nor --spec"),
        (("/nowhere.yaml", "--node", "a"), "there is no such file"),
    ],
)
def test_what_cannot_be_used_ends_with_2_and_one_line(arguments: tuple[str, ...], words: str) -> None:
    done = run("dockerfile", *arguments)
    assert (done.exit_code, len(done.stderr.splitlines())) == (2, 1)
    assert words in done.stderr


def test_of_several_built_nodes_one_must_be_named(tmp_path: Path) -> None:
    resource = yaml.safe_load(SAMPLE.read_text())
    node = resource["spec"]["nodes"][0]
    resource["spec"]["nodes"].append({**node, "name": "planner", "outputs": []})
    file = tmp_path / "two.yaml"
    file.write_text(yaml.safe_dump(resource))
    assert "--node: which one? It has controller, planner" in run("dockerfile", str(file)).stderr
    assert run("dockerfile", str(file), "--node", "planner").exit_code == 0


def test_rendering_shows_the_job_and_what_it_reads() -> None:
    kinds = [one["kind"] for one in yaml.safe_load_all(run("render", "file", str(SAMPLE)).stdout)]
    assert kinds[:2] == ["ConfigMap", "Job"]


STATUS = {
    "observedGeneration": 1,
    "nodes": [
        {
            "name": "controller",
            "replicas": 1,
            "ready": True,
            "image": "registry.example/robots/controller@sha256:" + "7" * 64,
            "commit": "8a5b1c2d3e4f5a6b7c8d9e0f1a2b3c4d5e6f7a8b",
        }
    ],
    "conditions": [
        {
            "type": "ImageBuilt",
            "status": "False",
            "reason": "BuildFailed",
            "message": "The image of controller could not be built (Job j):\nbuild: error: no such file",
        }
    ],
}
OFFLOAD = observe({"metadata": {"name": "walker", "namespace": "ward", "generation": 1}, "status": STATUS})


def test_status_shows_the_commit_that_runs(capsys: pytest.CaptureFixture[str]) -> None:
    Console(width=200, color_system=None).print(show.details(OFFLOAD, Live(None, ""), NOW))
    shown = capsys.readouterr().out
    assert "8a5b1c2d3e4f" in shown
    assert "build: error: no such file" in shown
    assert show.plain(OFFLOAD, Live(None, ""))["nodes"][0]["commit"].startswith("8a5b")


def test_explain_names_the_failing_line_and_the_next_step() -> None:
    [problem, *_] = explain(OFFLOAD, deleting=False, events=(), now=NOW).problems
    assert problem.reason == "BuildFailed"
    assert "build: error: no such file" in problem.message
    assert "kubectl delete job -n ward -l app.kubernetes.io/instance=walker" in problem.step
