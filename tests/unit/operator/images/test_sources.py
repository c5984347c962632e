"""The shell of the stage `sources`, run by a real shell with a real git; a folder stands for the root of the image."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path
from typing import Any

import pytest

from robot_offload.images.dockerfiles import dockerfile
from tests.unit.operator.images import parsed
from tests.unit.operator.images.specs import build_spec


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    """A repository with two packages, one of them in a folder with a space."""
    folder = tmp_path / "repository"
    for name in ("src/controller", "src/my messages", "docs"):
        (folder / name).mkdir(parents=True)
        (folder / name / "package.xml").write_text(f"<package>{name}</package>")
        (folder / name / "code.py").write_text("pass\n")
    git(folder, "init", "--quiet", "--initial-branch=main")
    git(folder, "add", "--all")
    git(folder, "commit", "--quiet", "-m", "one")
    git(folder, "tag", "v1")
    (folder / "src/controller/code.py").write_text("new\n")
    git(folder, "commit", "--quiet", "--all", "-m", "two")
    return folder


def git(folder: Path, *arguments: str) -> str:
    """Runs git in the repository."""
    identity = ("-c", "user.name=a", "-c", "user.email=a@example.com")
    return subprocess.check_output(("git", "-C", str(folder), *identity, *arguments), text=True).strip()


def fetched(tmp_path: Path, **source: Any) -> dict[str, str]:
    """The files that the stage leaves, with their text; after the manifests were copied as well."""
    text = dockerfile(build_spec(workspace=None, git=source)).split("AS dependencies")[0]
    home = tmp_path / "home"
    home.mkdir()
    for command in parsed.shell_commands(text):
        moved = command.replace("/ws", f"{tmp_path}/ws").replace("/run/secrets", f"{tmp_path}/secrets")
        done = subprocess.run(
            ["sh", "-c", moved], text=True, capture_output=True, check=False, env=os.environ | {"HOME": str(home)}
        )
        assert done.returncode == 0, done.stderr
    root = tmp_path / "ws"
    return {str(path.relative_to(root)): path.read_text() for path in sorted(root.rglob("*")) if path.is_file()}


def test_only_the_named_folders_are_fetched(repository: Path, tmp_path: Path) -> None:
    files = fetched(tmp_path, url=f"file://{repository}", ref="main", paths=["src/controller", "src/my messages"])
    assert [name for name in files if name.startswith("src/")] == [
        "src/src/controller/code.py",
        "src/src/controller/package.xml",
        "src/src/my messages/code.py",
        "src/src/my messages/package.xml",
    ]
    assert files["src/src/controller/code.py"] == "new\n"


def test_the_manifests_are_the_package_files_alone_without_a_time(repository: Path, tmp_path: Path) -> None:
    files = fetched(tmp_path, url=f"file://{repository}")
    manifests = [name for name in files if name.startswith("manifests/")]
    assert manifests == [
        "manifests/docs/package.xml",
        "manifests/src/controller/package.xml",
        "manifests/src/my messages/package.xml",
    ]
    assert {(tmp_path / "ws" / name).stat().st_mtime for name in manifests} == {0.0}


@pytest.mark.parametrize("kind", ["tag", "commit"])
def test_an_older_version_is_fetched_by_tag_or_commit(kind: str, repository: Path, tmp_path: Path) -> None:
    ref = "v1" if kind == "tag" else git(repository, "rev-parse", "v1")
    files = fetched(tmp_path, url=f"file://{repository}", ref=ref, paths=["src/controller"])
    assert files["src/src/controller/code.py"] == "pass\n"


def test_a_token_is_read_from_the_secret_and_kept_nowhere(tmp_path: Path) -> None:
    source = {"url": "https://git.example/robot.git", "credentials": "Token"}
    command = parsed.shell_commands(dockerfile(build_spec(workspace=None, git=source)))[0]
    secret = tmp_path / "git-credentials"
    secret.write_text("https://robot:se-cret@git.example\n")
    configured = command.split("git init")[0].replace("/run/secrets/git-credentials", str(secret))
    asked = f"{configured} printf 'protocol=https\\nhost=git.example\\n' | git credential fill"
    environment = os.environ | {"HOME": str(tmp_path), "GIT_TERMINAL_PROMPT": "0"}
    answer = subprocess.check_output(["sh", "-c", asked], text=True, env=environment)
    assert "username=robot\npassword=se-cret\n" in answer
    stored = f"{configured} printf 'protocol=https\\nhost=x\\nusername=u\\npassword=p\\n' | git credential approve"
    subprocess.run(["sh", "-c", stored], check=True, env=environment)
    assert secret.read_text() == "https://robot:se-cret@git.example\n", "git must not write into the secret"
    assert "se-cret" not in (tmp_path / ".gitconfig").read_text()
