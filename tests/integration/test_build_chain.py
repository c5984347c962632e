"""The three steps of a build Job, really run: git, rootless buildah with the rights of its container, a push.

The kubelet's part is done by hand (`build_pod`), and the registry is a stand-in in memory; git and buildah are real.
"""

from __future__ import annotations

import base64
import gzip
import io
import json
import shutil
import subprocess
import tarfile
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from robot_offload.decide.build_log import failing_lines
from robot_offload.decide.build_specs import build_plans
from robot_offload.objects.parent import Parent
from robot_offload.render import build_scripts as scripts
from robot_offload.render.build_job import build_files, build_job
from tests.integration.build_pod import BuildPod, why_not
from tests.integration.pretended_registry import PASSWORD, USER, PretendedRegistry
from tests.integration.test_build_scripts import git
from tests.unit.operator.render.given import facts
from tests.unit.operator.render.test_build_job import built

# The Dockerfile is a small one: what a generated one does is tested with the images. Here it must run a command as
# root of its own, own a file of somebody else, and look for what it must not see.
DOCKERFILE = """\
FROM scratch
COPY root /
COPY src/message /message
RUN ["/bin/sh", "-c", "read line < /message && echo built $line > /result && test $line != broken"]
"""

SOURCE_URL = "https://git.example/robots/planner.git"
"""What the resource names; git is told to read a folder instead."""

pytestmark = [
    pytest.mark.images,
    pytest.mark.timeout(1200),  # of several containers, each of which may take some minutes on a busy machine
    pytest.mark.skipif(why_not() is not None, reason=f"this machine {why_not()}"),
]


@pytest.fixture
def registry() -> Iterator[PretendedRegistry]:
    registry = PretendedRegistry()
    yield registry
    registry.close()


@pytest.fixture
def folder() -> Iterator[Path]:
    """A folder that every user reaches, which pytest's own are not."""
    found = Path(tempfile.mkdtemp(prefix="robot-offload-build-"))
    yield found
    shutil.rmtree(found)


def git_instead(url: str, other: str) -> dict[str, str]:
    """Returns the environment in which git reads `other` where `url` is named."""
    return {"GIT_CONFIG_COUNT": "1", "GIT_CONFIG_KEY_0": f"url.{other}.insteadOf", "GIT_CONFIG_VALUE_0": url}


def pod(
    folder: Path, registry: PretendedRegistry, message: str = "hello", rights: dict[str, Any] | None = None
) -> BuildPod:
    """The Pod of a build whose source holds `message`; `rights` replace some of those of its builder."""
    source = folder / "source"
    source.mkdir()
    git(source, "init", "--quiet")
    (source / "message").write_text(f"{message}\n")
    git(source, "add", ".")
    git(source, "commit", "--quiet", "--message", "first")
    subprocess.run(["chown", "-R", "65534", source], check=True)
    offload = built({"git": {"url": SOURCE_URL}}, {"repository": f"{registry.address}/robots", "insecure": True})
    [plan] = build_plans(offload, "")
    spec = build_job(Parent(offload, facts()), plan)["spec"]["template"]["spec"]
    spec["initContainers"][1]["securityContext"] |= rights or {}
    made = BuildPod(
        folder,
        spec,
        {**build_files(Parent(offload, facts()), plan)["data"], scripts.DOCKERFILE: DOCKERFILE},
    )
    made.environment = git_instead(SOURCE_URL, f"file://{source}")
    fetched = made.run("fetch")
    assert fetched.returncode == 0, fetched.stderr
    _shell_into(folder / "scratch" / "context" / "root")
    return made


def _shell_into(root: Path) -> None:
    """This machine's smallest shell with its libraries."""
    needed = subprocess.run(["ldd", "/bin/sh"], capture_output=True, text=True, check=True).stdout.split()
    for file in ["/bin/sh", *(word for word in needed if word.startswith("/"))]:
        target = root / file.lstrip("/")
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(file, target)


def auth(registry: PretendedRegistry, password: str = PASSWORD) -> dict[str, str]:
    """The file of a Secret of type kubernetes.io/dockerconfigjson."""
    login = base64.b64encode(f"{USER}:{password}".encode()).decode()
    return {scripts.AUTH_FILE: json.dumps({"auths": {registry.address: {"auth": login}}})}


def files_in(registry: PretendedRegistry, name: str) -> dict[str, str]:
    """The small files of an image in the registry."""
    manifest = json.loads(registry.manifests[name][1])
    found = {}
    for layer in manifest["layers"]:
        blob = registry.blobs[layer["digest"]]
        with tarfile.open(fileobj=io.BytesIO(gzip.decompress(blob))) as archive:
            for member in archive:
                content = archive.extractfile(member) if member.isfile() and member.size < 1000 else None
                if content is not None:
                    found[member.name] = content.read().decode()
    return found


def test_source_becomes_an_image_in_the_registry_and_commit_and_digest_are_told(
    folder: Path, registry: PretendedRegistry
) -> None:
    job = pod(folder, registry)
    done = job.run("build")
    assert done.returncode == 0, done.stderr
    pushed = job.run("push", auth(registry))
    assert pushed.returncode == 0, pushed.stderr
    told = json.loads(job.told)
    assert told["commit"] == job.file("commit")
    assert files_in(registry, f"robots/planner@{told['digest']}")["result"] == "built hello\n"
    [tag] = [name for name in registry.manifests if ":" in name and "@" not in name]
    assert tag.endswith(f"-{told['commit'][:12]}")


def test_what_a_build_leaves_beside_its_image_counts_for_nothing_where_the_credentials_are(
    folder: Path, registry: PretendedRegistry
) -> None:
    job = pod(folder, registry)
    assert job.run("build").returncode == 0
    for left in ("build", "layers", "run"):  # as a step that has left its chroot would have changed them
        place = folder / "scratch" / left
        shutil.rmtree(place, ignore_errors=True)
        place.symlink_to("/etc")
    pushed = job.run("push", auth(registry))
    assert pushed.returncode == 0, pushed.stderr
    digest = json.loads(job.told)["digest"]
    assert files_in(registry, f"robots/planner@{digest}")["result"] == "built hello\n"


@pytest.mark.parametrize(
    "rights",
    [{"allowPrivilegeEscalation": False}, {"capabilities": {"drop": ["ALL"]}}, {"capabilities": {"add": ["SETUID"]}}],
    ids=str,
)
def test_with_fewer_rights_nothing_can_be_built(
    rights: dict[str, Any], folder: Path, registry: PretendedRegistry
) -> None:
    assert pod(folder, registry, rights=rights).run("build").returncode != 0


def test_what_is_in_the_registry_already_is_not_built_again(folder: Path, registry: PretendedRegistry) -> None:
    job = pod(folder, registry)
    assert job.run("build", auth(registry)).returncode == 0
    assert job.run("push", auth(registry)).returncode == 0
    first = json.loads(job.told)["digest"]
    shutil.rmtree(folder / "scratch" / "build" / "layers")
    again = job.run("build", auth(registry))
    assert "is in the registry already" in again.stdout
    assert job.run("push", auth(registry)).returncode == 0
    assert json.loads(job.told)["digest"] == first


def test_a_step_that_fails_is_told_by_its_line(folder: Path, registry: PretendedRegistry) -> None:
    done = pod(folder, registry, "broken").run("build")
    assert done.returncode != 0
    ended = {"exitCode": done.returncode, "message": done.stdout + done.stderr}
    pods = [{"status": {"initContainerStatuses": [{"name": "build", "state": {"terminated": ended}}]}}]
    assert failing_lines(pods).startswith("build: ")
    assert registry.manifests == {}


def test_a_wrong_password_is_told_and_nothing_is_pushed(folder: Path, registry: PretendedRegistry) -> None:
    job = pod(folder, registry)
    assert job.run("build").returncode == 0
    done = job.run("push", auth(registry, "wrong"))
    assert done.returncode != 0
    ended = {"exitCode": done.returncode, "message": done.stderr}
    pods = [{"status": {"containerStatuses": [{"name": "push", "state": {"terminated": ended}}]}}]
    assert "push: Error: pushing image" in failing_lines(pods)
    assert any(word in failing_lines(pods) for word in ("unauthorized", "authentication", "401"))
    assert registry.manifests == {}
