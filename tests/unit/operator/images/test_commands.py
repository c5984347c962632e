"""The commands `dockerfile` and `build` as a person meets them."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import Result
from typer.testing import CliRunner

from robot_offload.cli.app import commands
from robot_offload.cli.images import build, dockerfile

NODE = ("--workspace", "src", "--package", "controller", "--executable", "server")


def run(*arguments: str) -> Result:
    """Runs one of the two commands."""
    app = commands("Images.")
    dockerfile.add_to(app)
    build.add_to(app)
    return CliRunner().invoke(app, list(arguments))


def test_dockerfile_prints_the_text_and_nothing_else_on_standard_output() -> None:
    done = run("dockerfile", *NODE, "--distro", "foxy")
    assert done.exit_code == 0
    assert done.stdout.startswith("# Made by `robot-offload dockerfile`")
    assert "warning: --distro: foxy is end of life" in done.stderr


def test_dockerfile_writes_a_file_and_reads_a_block(tmp_path: Path) -> None:
    block = tmp_path / "build.yaml"
    block.write_text("build:\n  workspace: {}\n  package: controller\n  executable: server\n")
    done = run("dockerfile", "--spec", str(block), "--output", str(tmp_path / "Dockerfile"))
    assert (done.exit_code, done.output) == (0, "")
    assert (tmp_path / "Dockerfile").read_text() == run("dockerfile", *NODE).stdout


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("dockerfile", "--package", "a", "--executable", "b"), "needs exactly one source, found none"),
        (("dockerfile", *NODE, "--rmw", "rmw_none"), "--rmw: rmw_none is not packaged for jazzy"),
        (("dockerfile", *NODE, "--spec", "/nowhere.yaml"), "there is no such file"),
        (("dockerfile", "--agent", "--spec", "x"), "--spec: does not go with --agent"),
        (("dockerfile", "--agent"), "name the image with the messages"),
        (("dockerfile", *NODE, "--output", "/nowhere/Dockerfile"), "cannot be written"),
        (("build", "-t", "a:1", *NODE, "--context", "/nowhere"), "there is no such folder"),
        (("build", "-t", "a:1", *NODE, "--pin"), "--pin: goes with --git only"),
        (("build", "-t", "a:1", *NODE, "--builder", "make"), "'make' is not known"),
        (("build", "-t", "-v", *NODE, "--builder", "podman", "--dry-run"), "is not an image's name"),
    ],
)
def test_what_cannot_be_used_ends_with_2_and_one_line(arguments: tuple[str, ...], words: str) -> None:
    done = run(*arguments)
    assert done.exit_code == 2
    assert words in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_a_dry_run_prints_the_dockerfile_and_the_command_and_runs_nothing() -> None:
    done = run("build", "--tag", "a:1", *NODE, "--builder", "podman", "--push", "--dry-run")
    assert done.exit_code == 0
    assert done.stdout.startswith(run("dockerfile", *NODE).stdout)
    assert done.stdout.splitlines()[-2:] == [
        "# podman build --layers --tag a:1 --file - .",
        "# podman push a:1",
    ]


def test_secrets_and_the_ssh_agent_reach_the_builder_only() -> None:
    options = ("--secret", "id=git-credentials,src=token.txt", "--ssh", "--builder-argument=--no-cache")
    done = run("build", "--tag", "a:1", *NODE, "--builder", "docker", "--dry-run", *options)
    command = done.stdout.splitlines()[-1]
    assert "--secret id=git-credentials,src=token.txt --ssh default --no-cache" in command
    assert "token.txt" not in done.stdout.removesuffix(command + "\n")


def test_source_date_epoch_must_be_a_number(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "yesterday")
    assert "SOURCE_DATE_EPOCH" in run("build", "--tag", "a:1", *NODE, "--dry-run", "--builder", "docker").stderr
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    done = run("build", "--tag", "a:1", *NODE, "--dry-run", "--builder", "buildah")
    assert "--timestamp 1700000000" in done.stdout


def test_help_teaches_with_examples() -> None:
    for command in ("dockerfile", "build"):
        text = run(command, "--help").stdout
        assert "Examples:" in text
        assert "--git" in text
