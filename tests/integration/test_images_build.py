"""Real builds: a generated Dockerfile, buildah, and the image's node under runc, not root, on a read-only root.

No container registry is needed: the base is Debian, this CPython and ROS 2 as wheels (`images/wheels-base`).
"""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from robot_offload.images import wheels_base
from robot_offload.images.ours import ROOT

MISSING = [name for name in ("buildah", "runc", "git") if shutil.which(name) is None]
if not wheels_base.archives_are_kept() and shutil.which("debootstrap") is None:
    MISSING.append("debootstrap")
pytestmark = [
    pytest.mark.images,
    pytest.mark.timeout(2400),
    pytest.mark.skipif(bool(MISSING), reason=f"not installed: {', '.join(MISSING)}"),
    pytest.mark.skipif(os.geteuid() != 0, reason="needs root"),
]
WAIT_S = 120.0
DOMAIN = "87"
TAGS = ("localhost/talker:1", "localhost/talker:2", "localhost/talker:3", "localhost/talker:4")
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


class Machine:
    """Builders and images of this test run, apart from those of the machine."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.environment = os.environ | {
            "BUILDAH_ISOLATION": "chroot",
            "CONTAINERS_STORAGE_CONF": str(folder / "storage.conf"),
            "TMPDIR": str(folder / "tmp"),
        }
        (folder / "tmp").mkdir()
        (folder / "storage.conf").write_text(
            f'[storage]\ndriver = "overlay"\ngraphroot = "{folder}/root"\nrunroot = "{folder}/run"\n'
        )

    def run(self, *command: str, check: bool = True) -> str:
        """Runs a program; its output."""
        done = subprocess.run(
            command, env=self.environment, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False
        )
        assert not check or done.returncode == 0, done.stdout[-4000:]
        return done.stdout

    def build(self, tag: str, *options: str) -> str:
        """Builds an image; what is printed."""
        return self.run(*self.command(tag, *options))

    def command(self, tag: str, *options: str) -> tuple[str, ...]:
        """`robot-offload build` with buildah, on our base."""
        return (
            sys.executable, "-m", "robot_offload", "build", "--builder", "buildah", "--tag", tag,
            "--base", wheels_base.tag("ros-base"), "--runtime-base", wheels_base.tag("ros-core"),
            *(f"--builder-argument={argument}" for argument in trust()), *options,
        )  # fmt: skip

    @contextmanager
    def mounted(self, image: str) -> Iterator[Path]:
        """The files of an image."""
        container = self.run("buildah", "from", "--pull-never", image).split()[-1]
        try:
            yield Path(self.run("buildah", "mount", container).strip())
        finally:
            self.run("buildah", "rm", container)

    def configuration(self, image: str) -> dict[str, object]:
        """Entry point, command, user and environment of an image."""
        inspected = json.loads(self.run("buildah", "inspect", "--type", "image", image))
        return dict(inspected["Docker"]["config"])


def trust() -> tuple[str, ...]:
    """Builder arguments that let pip inside a build trust what this machine trusts."""
    bundle = "/etc/ssl/certs/ca-certificates.crt"
    return ("-v", f"{bundle}:{bundle}:ro", "-v", f"{ROOT}/tests/integration/test_images_pip.conf:/etc/pip.conf:ro")


@pytest.fixture(scope="module")
def machine() -> Iterator[Machine]:
    """A machine with the base images. They are kept from run to run, in the cache folder of the archives."""
    folder = wheels_base.cache_folder() / "test"
    shutil.rmtree(folder / "tmp", ignore_errors=True)
    folder.mkdir(parents=True, exist_ok=True)
    machine = Machine(folder)
    before = dict(os.environ)
    os.environ.update(machine.environment)
    try:
        wheels_base.build("buildah", ROOT, trust())
    finally:
        os.environ.clear()
        os.environ.update(before)
    try:
        yield machine
    finally:
        machine.run("buildah", "rm", "--all", check=False)
        machine.run("buildah", "rmi", "--force", *TAGS, check=False)
        # What the builds left behind; the images of the base and the steps that lead to them stay.
        machine.run("buildah", "rmi", "--prune", check=False)


@pytest.fixture(scope="module")
def repository(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A git repository with a lifecycle node, and with much that nobody needs."""
    folder = tmp_path_factory.mktemp("repository")
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
    git(folder, "init", "--quiet", "--initial-branch=main")
    commit(folder)
    return folder


def git(folder: Path, *arguments: str) -> str:
    """Runs git in the repository."""
    identity = ("-c", "user.name=Talker", "-c", "user.email=talker@example.com")
    return subprocess.check_output(("git", "-C", str(folder), *identity, *arguments), text=True).strip()


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
    """The node's image."""
    machine.build(TAGS[0], *node_options(repository))
    return TAGS[0]


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


def test_the_node_answers_get_state_without_root_on_a_read_only_root(machine: Machine, image: str) -> None:
    with running(machine, image) as (container, process):
        asked = ask(container, "present")
        assert asked.returncode == 0, asked.stderr
        assert ask(container, "active").returncode == 1, "nobody has activated it: the agent does"
        activated = ask(container, "activate")
        assert activated.returncode == 0, activated.stderr
        assert ask(container, "active").returncode == 0
        assert exec_in(container, "id", "--user").stdout.strip() == "1000"
        assert exec_in(container, "touch", "/opt/x").returncode != 0, "the root file system is read-only"
        comm = exec_in(container, "cat", "/proc/1/comm", "/proc/1/task/1/children").stdout.split()
        assert comm[0] == "tini"
        subprocess.run(("runc", "kill", container, "TERM"), check=True)
        assert process.wait(WAIT_S) in (0, 128 + signal.SIGTERM), "it ended by itself"


def test_a_changed_line_is_built_from_the_caches(machine: Machine, image: str, repository: Path) -> None:
    node = repository / "src/talker/talker/node.py"
    node.write_text(node.read_text().replace("hello", "good day"), encoding="utf-8")
    commit(repository)
    output = machine.build(TAGS[1], *node_options(repository))
    steps = re.split(r"(?=^\[\d/\d\] STEP )", output, flags=re.MULTILINE)
    (rosdep,) = [step for step in steps if "rosdep update" in step.split("\n")[0]]
    assert "Using cache" in rosdep, "dependencies depend on package.xml only"
    with machine.mounted(TAGS[1]) as root:
        assert "good day" in next(root.glob("opt/overlay/lib/python3*/site-packages/talker/node.py")).read_text()


def test_a_wrong_name_is_told_with_the_right_ones(machine: Machine, image: str, repository: Path) -> None:
    wrong = node_options(repository, "--package", "tolker")
    output = machine.run(*machine.command("localhost/talker:wrong", *wrong), check=False)
    assert "The source has these packages:\ntalker\n" in output
    assert "buildah could not build localhost/talker:wrong" in output


def test_the_same_source_gives_the_same_image(machine: Machine, repository: Path) -> None:
    machine.environment["SOURCE_DATE_EPOCH"] = "1700000000"
    try:
        for tag in TAGS[2:]:
            # With a health check the format would be docker's, where buildah writes a random host name.
            plain = ("--health-check", "None", "--builder-argument=--no-cache")
            machine.build(tag, *node_options(repository, *plain))
    finally:
        del machine.environment["SOURCE_DATE_EPOCH"]
    first, second = (layers_of(machine, tag) for tag in TAGS[2:])
    assert first == second
    ids = [machine.run("buildah", "images", "--no-trunc", "--format", "{{.ID}}", tag).strip() for tag in TAGS[2:]]
    assert ids[0] == ids[1], "the digest of the configuration: times, labels, history"


def layers_of(machine: Machine, image: str) -> list[str]:
    """The digests of an image's layers."""
    inspected = json.loads(machine.run("buildah", "inspect", "--type", "image", image))
    return list(inspected["OCIv1"]["rootfs"]["diff_ids"])


@contextmanager
def running(machine: Machine, image: str) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """The image as a container of runc, with the rights of a pod in a restricted namespace."""
    name = f"robot-offload-test-{os.getpid()}"
    with machine.mounted(image) as root:
        bundle = machine.folder / "tmp" / name
        bundle.mkdir()
        write_bundle(bundle, root, machine.configuration(image))
        process = subprocess.Popen(("runc", "run", "--bundle", str(bundle), name), text=True)
        try:
            wait_until_running(name)
            yield name, process
        finally:
            subprocess.run(("runc", "delete", "--force", name), check=False, capture_output=True)
            process.wait(WAIT_S)
            shutil.rmtree(bundle)


def write_bundle(bundle: Path, root: Path, image: dict[str, object]) -> None:
    """runc's own default specification, with the image's configuration and fewer rights."""
    subprocess.run(("runc", "spec", "--bundle", str(bundle)), check=True)
    path = bundle / "config.json"
    spec = json.loads(path.read_text())
    user, group = (int(part) for part in str(image["User"]).split(":"))
    no_rights: dict[str, list[str]] = {key: [] for key in spec["process"]["capabilities"]}
    spec["process"] |= {
        "terminal": False,
        "user": {"uid": user, "gid": group},
        "args": [*image["Entrypoint"], *image["Cmd"]],  # type: ignore[misc]
        "env": image["Env"],
        "capabilities": no_rights,
        "noNewPrivileges": True,
    }
    spec["root"] = {"path": str(root), "readonly": True}
    spec["mounts"].append(
        {"destination": "/tmp", "type": "tmpfs", "source": "tmpfs", "options": ["nosuid", "nodev", "mode=1777"]}
    )
    path.write_text(json.dumps(spec))


def wait_until_running(name: str) -> None:
    """Waits for the container's first process."""
    deadline = time.monotonic() + WAIT_S
    while time.monotonic() < deadline:
        state = subprocess.run(("runc", "state", name), capture_output=True, text=True, check=False)
        if state.returncode == 0 and json.loads(state.stdout)["status"] == "running":
            return
        time.sleep(0.2)
    raise AssertionError("the container did not start")


def exec_in(name: str, *command: str) -> subprocess.CompletedProcess[str]:
    """Runs a program in the container."""
    return subprocess.run(
        ("runc", "exec", "--user", "1000:1000", name, *command),
        text=True,
        capture_output=True,
        check=False,
        timeout=WAIT_S,
    )


def ask(name: str, what: str) -> subprocess.CompletedProcess[str]:
    """The image's own helper, as its health check runs it."""
    helper = ("/usr/local/bin/robot-offload-node", "python3", "/usr/local/lib/robot-offload-lifecycle.py", what)
    for _ in range(10):
        done = exec_in(name, *helper)
        if done.returncode == 0 or what == "active":
            break
    return done
