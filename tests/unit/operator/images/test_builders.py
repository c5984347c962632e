"""The command lines of docker, podman and buildah, and which of them is taken."""

from __future__ import annotations

import subprocess
from dataclasses import replace
from pathlib import Path

import pytest

from robot_offload.errors import InputError
from robot_offload.images.builders import (
    TOOLS,
    BuildError,
    NoBuilderError,
    Request,
    choose,
    commands,
    look_up_commit,
    run,
)

REQUEST = Request(tag="registry.example/a:1", context=Path("/ws"))


def test_a_plain_build_reads_the_dockerfile_from_standard_input() -> None:
    assert commands("docker", REQUEST) == (("docker", "build", "--tag", "registry.example/a:1", "--file", "-", "/ws"),)
    assert commands("podman", REQUEST)[0][:3] == ("podman", "build", "--layers")
    assert commands("buildah", REQUEST)[0][:3] == ("buildah", "build", "--layers")


def test_a_push_follows_the_build() -> None:
    for tool in TOOLS:
        assert commands(tool, replace(REQUEST, push=True))[1:] == ((tool, "push", "registry.example/a:1"),)


def test_several_platforms_become_one_manifest() -> None:
    request = replace(REQUEST, platforms=("linux/amd64", "linux/arm64"), push=True)
    (docker,) = commands("docker", request)
    assert docker[:3] == ("docker", "buildx", "build")
    assert docker[-2:] == ("--push", "/ws")
    build, push = commands("buildah", request)
    assert build[3:5] == ("--manifest", "registry.example/a:1")
    assert build[7:9] == ("--platform", "linux/amd64,linux/arm64")
    assert push[-2:] == ("registry.example/a:1", "docker://registry.example/a:1")
    with pytest.raises(InputError, match="add --push"):
        commands("docker", replace(request, push=False))


def test_a_health_check_needs_the_format_of_docker() -> None:
    assert "--format" in commands("buildah", replace(REQUEST, health_check=True))[0]
    assert "--format" not in commands("docker", replace(REQUEST, health_check=True))[0]


def test_source_date_epoch_reaches_every_builder() -> None:
    request = replace(REQUEST, source_date_epoch=7)
    assert "SOURCE_DATE_EPOCH=7" in commands("docker", request)[0]
    assert commands("podman", request)[0][-3:-1] == ("--timestamp", "7")


@pytest.mark.parametrize("tag", ["-v", "", "a b", "UPPER/Case:1", "a:1 --privileged", "a\n:1"])
def test_a_tag_that_could_be_an_option_is_refused(tag: str) -> None:
    with pytest.raises(InputError, match="--tag"):
        commands("buildah", replace(REQUEST, tag=tag))


def test_a_platform_that_is_none_is_refused() -> None:
    with pytest.raises(InputError, match="--platform"):
        commands("buildah", replace(REQUEST, platforms=("linux/amd64,--privileged",)))


def test_the_first_builder_that_works_is_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(NoBuilderError, match="install docker, podman or buildah") as told:
        choose()
    assert "podman: is not installed" in told.value.lines
    program(tmp_path / "buildah", "exit 0")
    assert choose() == "buildah"
    program(tmp_path / "docker", "exit 1")
    assert choose() == "buildah", "a docker client without its daemon builds nothing"
    with pytest.raises(NoBuilderError, match="its daemon does not answer"):
        choose("docker")
    program(tmp_path / "docker", "exit 0")
    assert choose() == "docker"


def test_a_failed_build_names_the_image_and_the_next_step(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program(tmp_path / "buildah", "exit 125")
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(BuildError, match=r"could not build registry.example/a:1 \(it ended with 125\).*--dry-run"):
        run("buildah", REQUEST, "FROM scratch\n")


def test_a_branch_or_tag_is_looked_up_in_the_repository(tmp_path: Path) -> None:
    git = ("git", "-C", str(tmp_path), "-c", "user.name=a", "-c", "user.email=a@example.com")
    subprocess.run((*git, "init", "--quiet", "--initial-branch=main"), check=True)
    subprocess.run((*git, "commit", "--quiet", "--allow-empty", "-m", "one"), check=True)
    subprocess.run((*git, "tag", "-a", "v1", "-m", "v1"), check=True)
    head = subprocess.check_output((*git, "rev-parse", "HEAD"), text=True).strip()
    for ref in ("main", "v1", "HEAD"):
        assert look_up_commit(f"file://{tmp_path}", ref) == head
    with pytest.raises(InputError, match="has no branch or tag missing"):
        look_up_commit(f"file://{tmp_path}", "missing")
    with pytest.raises(BuildError, match="cannot be asked"):
        look_up_commit(f"file://{tmp_path}/nowhere", "main")


def program(path: Path, text: str) -> None:
    """A program that stands for a builder where none can run."""
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
