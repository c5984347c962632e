"""`robot-offload init`: five answers, as options or at a terminal, become a commented file that is valid."""

import json
import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from robot_offload.api.files import load
from robot_offload.api.v1alpha1.parsing import parse_text
from robot_offload.cli.main import app

OPTIONS = (
    "--name", "walker", "--node", "controller", "--publishes", "/cmd_vel:geometry_msgs/msg/Twist:20",
    "--hears", "/scan",
    "--stop", "/wheels/inhibit", "--domain-id", "7",
)  # fmt: skip


def run(*words: str) -> tuple[int, str, str]:
    done = CliRunner().invoke(app, ["init", *words])
    return done.exit_code, done.stdout, done.stderr


def test_the_answers_become_a_valid_file_with_comments(tmp_path: Path) -> None:
    file = tmp_path / "walker.yaml"
    code, said, _ = run(*OPTIONS, "-o", str(file))
    assert code == 0
    spec = load(file).spec
    [node] = spec.nodes
    assert (node.name, node.placement, node.core) == ("controller", "Duplicated", True)
    assert (node.outputs[0].topic, node.outputs[0].rate_hz) == ("/cmd_vel", 20.0)
    assert [it.name for it in spec.topics.to_cloud] == ["/scan"]
    assert (spec.driver.inhibit_service, spec.robot.domain_id) == ("/wheels/inhibit", 7)
    assert spec.switching.latency.robot_period_ms == 50
    assert file.read_text().count("#") > 8
    assert "Next: add its run block" in said
    assert run(*OPTIONS, "-o", str(file))[0] == 2, "the file stays"


@pytest.mark.parametrize("rate", ["0.05", "1", "3", "50", "1000"])
def test_slow_and_fast_outputs_are_valid_too(rate: str) -> None:
    code, said, problem = run("--name", "a", "--node", "n", "--publishes", f"/a:std_msgs/msg/String:{rate}")
    assert code == 0, problem
    assert parse_text(said, "init").spec.nodes[0].outputs[0].rate_hz == float(rate)


def test_json_is_the_same_without_comments() -> None:
    code, said, _ = run(*OPTIONS, "--json")
    assert code == 0
    assert json.loads(said)["metadata"] == {"name": "walker"}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "--name, --node, --publishes is missing"),
        (("--name", "Walker 1", "--node", "n", "--publishes", "/a"), "is not a Kubernetes name"),
        (("--name", "w", "--node", "/n", "--publishes", "a"), "must start with a slash"),
        (("--name", "w", "--node", "n", "--publishes", "/a:std_msgs/msg/String:fast"), "'fast' is not a valid rate"),
        (("--name", "w", "--node", "n", "--publishes", "/a:b/msg/C:nan"), "finite"),
        (("--name", "w", "--node", "n", "--publishes", "/a", "--hears", "/a"), "crosses by itself"),
    ],
)  # fmt: skip
def test_an_answer_that_cannot_be_used_ends_with_2_and_says_why(words: tuple[str, ...], said: str) -> None:
    code, _, problem = run(*words)
    assert code == 2
    assert said in problem


def test_a_terminal_is_asked_five_questions() -> None:
    ours, theirs = pty.openpty()
    answers = "walker\ncontroller\n/cmd_vel:geometry_msgs/msg/Twist:20\n/scan /odom\n\n"
    os.write(ours, answers.encode())
    command = [sys.executable, "-m", "robot_offload", "init"]
    done = subprocess.run(command, stdin=theirs, capture_output=True, text=True, timeout=60, check=False)
    os.close(theirs)
    os.close(ours)
    assert done.returncode == 0, done.stderr
    spec = parse_text(done.stdout, "init").spec
    assert [it.name for it in spec.topics.to_cloud] == ["/scan", "/odom"]
    assert not spec.nodes[0].core
    assert done.stderr.count("Topics that it hears") == 1
