"""The fixed texts that build Jobs run: the one that fetches runs here for real, with real git and a real repository."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from robot_offload.decide.build_log import failing_lines
from robot_offload.render import build_scripts as scripts

SCRIPTS = {"fetch": scripts.FETCH, "build": scripts.BUILD, "push": scripts.PUSH}
Fetch = Callable[..., subprocess.CompletedProcess[str]]


def git(where: Path, *words: str) -> str:
    identity = ["-c", "user.name=test", "-c", "user.email=test@example.com", "-c", "init.defaultBranch=main"]
    done = subprocess.run(["git", *identity, *words], cwd=where, check=True, capture_output=True, text=True)
    return done.stdout.strip()


@dataclass(frozen=True)
class Source:
    """A repository with two packages, a tag `v1` and one commit after it."""

    folder: Path
    first: str
    second: str

    @property
    def url(self) -> str:
        return f"file://{self.folder}"


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Source]:
    folder = tmp_path_factory.mktemp("source")
    git(folder, "init", "--quiet")
    # Servers on the web allow both; without them a file:// server sends whole histories only.
    git(folder, "config", "uploadpack.allowFilter", "true")
    git(folder, "config", "uploadpack.allowAnySHA1InWant", "true")
    for name in ("wanted", "other", "with space"):
        (folder / "src" / name).mkdir(parents=True)
        (folder / "src" / name / "package.xml").write_text(f"<name>{name}</name>\n")
    git(folder, "add", ".")
    git(folder, "commit", "--quiet", "--message", "first")
    git(folder, "tag", "v1")
    first = git(folder, "rev-parse", "HEAD")
    (folder / "src" / "wanted" / "new").write_text("new\n")
    git(folder, "add", ".")
    git(folder, "commit", "--quiet", "--message", "second")
    yield Source(folder, first, git(folder, "rev-parse", "HEAD"))
    shutil.rmtree(folder)


@pytest.fixture
def fetch(tmp_path: Path) -> Fetch:
    """Runs the text with its folders moved below one of the test, and no waiting between attempts."""

    def run(
        url: str, ref: str = "HEAD", paths: str = "", path: str = os.environ["PATH"]
    ) -> subprocess.CompletedProcess[str]:
        script = scripts.FETCH
        for folder in (scripts.SCRATCH, scripts.GIT_SECRET_DIR):
            (tmp_path / folder.strip("/")).mkdir(parents=True, exist_ok=True)
            script = script.replace(folder, str(tmp_path / folder.strip("/")))
        script = script.replace("sleep 5", "sleep 0")
        environment = {"PATH": path, "GIT_URL": url, "GIT_REF": ref, "GIT_PATHS": paths}
        return subprocess.run(
            ["/bin/sh", "-c", script],
            env=environment,
            cwd="/",
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )

    return run


def context(tmp_path: Path) -> set[str]:
    folder = tmp_path / "scratch" / "context" / "src"
    return {str(file.relative_to(folder)) for file in folder.rglob("*") if file.is_file()}


@pytest.mark.parametrize("name", list(SCRIPTS))
def test_the_texts_are_good_shell(name: str) -> None:
    done = subprocess.run(["/bin/sh", "-n"], input=SCRIPTS[name], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_a_branch_becomes_one_commit_and_git_itself_stays_out(source: Source, fetch: Fetch, tmp_path: Path) -> None:
    done = fetch(source.url, "main")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "scratch/commit").read_text().strip() == source.second
    assert int((tmp_path / "scratch/time").read_text()) > 1_600_000_000
    assert "src/wanted/new" in context(tmp_path)
    assert not [file for file in context(tmp_path) if file.startswith(".git/")]


@pytest.mark.parametrize("ref", ["v1", "commit"])
def test_a_tag_and_a_commit_are_found(ref: str, source: Source, fetch: Fetch, tmp_path: Path) -> None:
    assert fetch(source.url, source.first if ref == "commit" else ref).returncode == 0
    assert (tmp_path / "scratch/commit").read_text().strip() == source.first
    assert "src/wanted/new" not in context(tmp_path)


def test_only_the_named_folders_are_fetched(source: Source, fetch: Fetch, tmp_path: Path) -> None:
    done = fetch(source.url, paths="src/wanted\nsrc/with space")
    assert done.returncode == 0, done.stderr
    assert {"src/wanted/package.xml", "src/with space/package.xml"} <= context(tmp_path)
    assert "src/other/package.xml" not in context(tmp_path)


def test_a_second_attempt_in_the_same_pod_starts_anew(source: Source, fetch: Fetch, tmp_path: Path) -> None:
    fetch(source.url, "main")
    assert fetch(source.url, "v1").returncode == 0
    assert (tmp_path / "scratch/commit").read_text().strip() == source.first
    assert "src/wanted/new" not in context(tmp_path)


def told(done: subprocess.CompletedProcess[str]) -> str:
    """What the condition would say of this container."""
    ended = {"exitCode": done.returncode, "message": done.stderr}
    return failing_lines([{"status": {"initContainerStatuses": [{"name": "fetch", "state": {"terminated": ended}}]}}])


def test_a_ref_that_does_not_exist_is_told(source: Source, fetch: Fetch) -> None:
    done = fetch(source.url, "v9")
    assert done.returncode != 0
    assert "couldn't find remote ref v9" in told(done)


def test_a_repository_that_does_not_exist_is_told(fetch: Fetch, tmp_path: Path) -> None:
    done = fetch(f"file://{tmp_path}/nothing")
    assert done.returncode != 0
    assert "does not appear to be a git repository" in told(done)


def test_an_image_without_git_is_told_with_the_next_step(fetch: Fetch) -> None:
    done = fetch("https://git.example/a", path="/nonexistent")
    assert "the chart's value images.git names one with git and ssh" in told(done)


def test_what_looks_like_a_command_stays_a_name(source: Source, fetch: Fetch, tmp_path: Path) -> None:
    witness = tmp_path / "witness"
    for url, ref, paths in (
        (f"file:///$(touch {witness})", "main", ""),
        (source.url, f"$(touch {witness})", ""),
        (source.url, "main", f"`touch {witness}`\n;touch {witness}"),
    ):
        fetch(url, ref, paths)
    assert not witness.exists()


def test_a_key_without_known_hosts_is_refused(source: Source, fetch: Fetch, tmp_path: Path) -> None:
    secret = tmp_path / scripts.GIT_SECRET_DIR.strip("/")
    secret.mkdir(parents=True)
    (secret / "ssh-privatekey").write_text("key")
    assert "no entry known_hosts" in told(fetch(source.url)) or "has no ssh" in told(fetch(source.url))


def test_a_token_is_given_to_git_and_left_nowhere_in_the_source(source: Source, fetch: Fetch, tmp_path: Path) -> None:
    secret = tmp_path / scripts.GIT_SECRET_DIR.strip("/")
    secret.mkdir(parents=True)
    (secret / "username").write_text("robot")
    (secret / "password").write_text('s3"cr$e t')
    assert fetch(source.url).returncode == 0
    home = tmp_path / "scratch/fetch"
    asked = subprocess.run(
        ["git", "credential", "fill"],
        input="protocol=https\nhost=git.example\n\n",
        env={"PATH": os.environ["PATH"], "HOME": str(home), "GIT_TERMINAL_PROMPT": "0"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert {"username=robot", 'password=s3"cr$e t'} <= set(asked.stdout.splitlines())
    for file in (tmp_path / "scratch").rglob("*"):
        assert not file.is_file() or "s3" not in file.read_text(errors="replace")
