"""Real builds: a generated Dockerfile, buildah, and the image's node under runc, not root, on a read-only root."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from robot_offload_lab.images import wheels_base
from robot_offload_lab.images.ours import ROOT
from tests.integration import images_machine
from tests.integration.images_machine import Container, Machine, figure, robot_offload

pytestmark = [pytest.mark.images, pytest.mark.timeout(2400)]
DOMAIN = "87"
FIRST, SECOND, *EQUAL = (f"localhost/talker:{number}" for number in (1, 2, 3, 4))
PACKAGE_XML = """<?xml version="1.0"?>
<package format="3">
  <name>talker</name><version>0.1.0</version><description>Says hello</description>
  <maintainer email="talker@example.com">Talker</maintainer><license>Apache-2.0</license>
  <exec_depend>rclpy</exec_depend><exec_depend>std_msgs</exec_depend>
  <export><build_type>ament_python</build_type></export>
</package>
"""
SETUP_PY = """from setuptools import setup
setup(name="talker", version="0.1.0", packages=["talker"],
      data_files=[("share/ament_index/resource_index/packages", ["resource/talker"]),
                  ("share/talker", ["package.xml"])],
      entry_points={"console_scripts": ["talker = talker.node:main"]})
"""


@pytest.fixture(scope="module")
def machine() -> Iterator[Machine]:
    """A machine with the base images."""
    with images_machine.machine("ros-core", "ros-base") as machine:
        yield machine
        machine.run("buildah", "rmi", "--force", SECOND, *EQUAL, check=False)
        # What the builds left behind; the images of the base and the steps that lead to them stay.
        machine.run("buildah", "rmi", "--prune", check=False)


def command(tag: str, *options: str) -> tuple[str, ...]:
    """`robot-offload build` with buildah, on our base."""
    lent = (f"--builder-argument={argument}" for argument in wheels_base.lent("buildah"))
    bases = ("--base", wheels_base.tag("ros-base"), "--runtime-base", wheels_base.tag("ros-core"))
    return robot_offload("build", "--builder", "buildah", "--tag", tag, *bases, *lent, *options)


@pytest.fixture(scope="module")
def repository(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A git repository with a lifecycle node, and with much that nobody needs."""
    folder = tmp_path_factory.mktemp("repository")
    write_source(folder)
    git(folder, "init", "--quiet", "--initial-branch=main")
    commit(folder)
    return folder


def write_source(folder: Path) -> None:
    """Writes a package with the lifecycle node talker, and one that nobody needs."""
    package = folder / "src" / "talker"
    for name, text in {
        "package.xml": PACKAGE_XML,
        "setup.py": SETUP_PY,
        "setup.cfg": "[develop]\nscript_dir=$base/lib/talker\n[install]\ninstall_scripts=$base/lib/talker\n",
        "resource/talker": "",
        "talker/__init__.py": "",
        "talker/node.py": (ROOT / "examples/talker/talker.py").read_text(encoding="utf-8"),
        "../not_needed/package.xml": PACKAGE_XML.replace("talker", "not_needed").replace("rclpy", "no_such_key"),
    }.items():
        (package / name).parent.mkdir(parents=True, exist_ok=True)
        (package / name).write_text(text, encoding="utf-8")


def git(folder: Path, *arguments: str) -> str:
    """Runs git in the repository; the same content is the same commit in every run."""
    identity = {
        f"GIT_{who}_{what}": "talker@example.com" for who in ("AUTHOR", "COMMITTER") for what in ("NAME", "EMAIL")
    }
    dates = {f"GIT_{who}_DATE": "2026-01-01T00:00:00Z" for who in ("AUTHOR", "COMMITTER")}
    command = ("git", "-C", str(folder), *arguments)
    return subprocess.check_output(command, text=True, env=os.environ | identity | dates).strip()


def commit(folder: Path) -> str:
    """Commits everything; the commit."""
    git(folder, "add", "--all")
    git(folder, "commit", "--quiet", "--message", "Change")
    return git(folder, "rev-parse", "HEAD")


def node_options(repository: Path, *more: str) -> tuple[str, ...]:
    """The options of the node's image."""
    return (
        "--git", "file:///srv/repository", "--ref", git(repository, "rev-parse", "HEAD"), "--path", "src/talker",
        "--package", "talker", "--executable", "talker", "--node", "/talker", "--health-check", "Active",
        "--fastdds-transports", "UDPv4", "--discovery-range", "Localhost", "--domain-id", DOMAIN,
        f"--builder-argument=--volume={repository}:/srv/repository:ro", *more,
    )  # fmt: skip


@pytest.fixture(scope="module")
def image(machine: Machine, repository: Path) -> str:
    """The node's image. It is kept: where nothing has changed, the next run takes the steps of its last stage."""
    started = time.monotonic()
    machine.run(*command(FIRST, *node_options(repository)))
    figure("first build of this run", f"{time.monotonic() - started:.0f} s")
    return FIRST


def test_only_the_result_is_in_the_image(machine: Machine, image: str) -> None:
    with machine.mounted(image) as root:
        assert (root / "opt/overlay/lib/talker/talker").exists()
        assert not (root / "ws").exists(), "no source code"
        assert not (root / "opt/overlay/share/not_needed").exists(), "only the package that was asked for"
        assert not (root / "usr/bin/git").exists(), "no tools of the build"
        assert (root / "etc/machine-id").read_text() == ""
    configuration = machine.configuration(image)
    assert configuration["User"] == "1000:1000"
    assert configuration["StopSignal"] == "SIGTERM"
    assert configuration["Healthcheck"]["Test"][-1] == "active"
    for name in (image, wheels_base.tag("ros-core"), wheels_base.tag("ros-base")):
        figure(f"size of {name}", machine.size(name))


def test_the_node_answers_get_state_without_root_on_a_read_only_root(machine: Machine, image: str) -> None:
    with machine.running(image) as container:
        asked = ask(container, "present")
        assert asked.returncode == 0, asked.stderr
        assert ask(container, "active").returncode == 1, "nobody has activated it: the agent does"
        activated = ask(container, "activate")
        assert activated.returncode == 0, activated.stderr
        container.until(lambda: ask(container, "active").returncode == 0)
        assert container.run("id", "--user").stdout.strip() == "1000"
        assert container.run("touch", "/opt/x").returncode != 0, "the root file system is read-only"
        assert container.run("cat", "/proc/1/comm").stdout.strip() == "tini"
        assert container.end() in (0, 128 + signal.SIGTERM), "it ended by itself"


def test_a_changed_line_is_built_from_the_caches(machine: Machine, image: str, repository: Path) -> None:
    node = repository / "src/talker/talker/node.py"
    word = f"good day {time.time_ns()}"  # never built before
    node.write_text(node.read_text().replace("hello", word), encoding="utf-8")
    commit(repository)
    started = time.monotonic()
    output = machine.run(*command(SECOND, *node_options(repository)))
    figure("build after one changed line", f"{time.monotonic() - started:.0f} s")
    steps = re.split(r"(?=^\[\d/\d\] STEP )", output, flags=re.MULTILINE)
    (rosdep,) = [step for step in steps if "rosdep update" in step.split("\n")[0]]
    assert "Using cache" in rosdep, "dependencies depend on package.xml only"
    with machine.mounted(SECOND) as root:
        assert word in next(root.glob("opt/overlay/lib/python3*/site-packages/talker/node.py")).read_text()


def test_a_wrong_name_is_told_with_the_right_ones(machine: Machine, image: str, repository: Path) -> None:
    wrong = node_options(repository, "--package", "tolker")
    output = machine.run(*command("localhost/talker:wrong", *wrong), check=False)
    assert "The source has these packages:\ntalker\n" in output
    assert "buildah could not build localhost/talker:wrong" in output


@pytest.mark.parametrize("kind", ["workspace", "repos"])
def test_a_workspace_and_a_repos_file_give_the_same_source_as_git(
    machine: Machine, image: str, repository: Path, tmp_path: Path, kind: str
) -> None:
    tag, context = f"localhost/talker:{kind}", tmp_path / "context"
    if kind == "workspace":
        shutil.copytree(repository / "src", context / "src")
        options: tuple[str, ...] = ("--workspace", "src")
    else:
        entry = f"{{type: git, url: file:///srv/repository, version: {git(repository, 'rev-parse', 'HEAD')}}}"
        context.mkdir()
        (context / "robot.repos").write_text(f"repositories:\n  robot: {entry}\n", encoding="utf-8")
        options = ("--repos", "robot.repos", f"--builder-argument=--volume={repository}:/srv/repository:ro")
    only_sources = ("--builder-argument=--target", "--builder-argument=sources")
    node = ("--package", "talker", "--executable", "talker", "--context", str(context))
    machine.run(*command(tag, *node, *options, *only_sources))
    try:
        with machine.mounted(tag) as root:
            (found,) = root.glob("ws/src/**/talker/talker/node.py")
            assert found.read_bytes() == (repository / "src/talker/talker/node.py").read_bytes()
            assert not list(root.glob("ws/src/**/.git")), "no history"
    finally:
        machine.run("buildah", "rmi", tag)


def test_the_same_source_gives_the_same_image(machine: Machine, repository: Path) -> None:
    machine.environment["SOURCE_DATE_EPOCH"] = "1700000000"
    try:
        for tag in EQUAL:
            # With a health check the format would be docker's, where buildah writes random names of its containers.
            plain = ("--health-check", "None", "--builder-argument=--no-cache")
            machine.run(*command(tag, *node_options(repository, *plain)))
    finally:
        del machine.environment["SOURCE_DATE_EPOCH"]
    first, second = (layers_of(machine, tag) for tag in EQUAL)
    assert first == second
    ids = [machine.run("buildah", "images", "--no-trunc", "--format", "{{.ID}}", tag).strip() for tag in EQUAL]
    assert ids[0] == ids[1], "the digest of the configuration: times, labels, history"


def layers_of(machine: Machine, image: str) -> list[str]:
    """The digests of an image's layers."""
    inspected = json.loads(machine.run("buildah", "inspect", "--type", "image", image))
    return list(inspected["OCIv1"]["rootfs"]["diff_ids"])


def ask(container: Container, what: str) -> subprocess.CompletedProcess[str]:
    """The image's own helper, as its health check runs it."""
    helper = ("/usr/local/bin/robot-offload-node", "python3", "/usr/local/lib/robot-offload-lifecycle.py", what)
    for _ in range(10):
        done = container.run(*helper)
        if done.returncode == 0 or what == "active":
            break
    return done
