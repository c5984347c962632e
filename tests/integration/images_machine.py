"""Where these tests build their images, and containers with the rights of a pod in a restricted namespace.

No container registry is needed: the base is Debian, this CPython and ROS 2 as wheels (`images/wheels-base`). The base
and the steps of builds are kept from run to run, in the cache folder of the archives.
"""

from __future__ import annotations

import fcntl
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from robot_offload_lab.images import wheels_base
from robot_offload_lab.images.ours import ROOT
from robot_offload_lab.images.wheels_base import Stage

WAIT_S = 120.0
MISSING = [name for name in ("buildah", "runc", "git") if shutil.which(name) is None]
if not wheels_base.archives_are_kept() and shutil.which("debootstrap") is None:
    MISSING.append("debootstrap")
IN_CI = os.environ.get("ROBOT_OFFLOAD_CI") == "1"


def need() -> None:
    """Skips where images cannot be built; in CI a missing program is a failure."""
    if os.geteuid() != 0:
        pytest.skip("images are built and run as root here. Next: run it with sudo")
    if MISSING and IN_CI:
        pytest.fail(f"images cannot be built here; missing: {', '.join(MISSING)}")
    if MISSING:
        pytest.skip(f"missing: {', '.join(MISSING)}")


class Machine:
    """Builders and images of the tests, apart from those of the machine."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.environment = os.environ | {
            "BUILDAH_ISOLATION": "chroot",
            "CONTAINERS_STORAGE_CONF": str(folder / "storage.conf"),
            "TMPDIR": str(folder / "tmp"),
        }

    def run(self, *command: str, check: bool = True) -> str:
        """Runs a program; its output."""
        done = subprocess.run(
            command, env=self.environment, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False
        )
        assert not check or done.returncode == 0, done.stdout[-4000:]
        return done.stdout

    def base(self, *stages: Stage) -> None:
        """Makes the stages of the base that are not there yet."""
        wheels_base.build("buildah", ROOT, wheels_base.lent("buildah"), stages, self.environment)

    @contextmanager
    def mounted(self, image: str) -> Iterator[Path]:
        """The files of an image."""
        container = self.run("buildah", "from", "--pull-never", image).split()[-1]
        try:
            yield Path(self.run("buildah", "mount", container).strip())
        finally:
            self.run("buildah", "rm", container)

    def configuration(self, image: str) -> dict[str, Any]:
        """Entry point, command, user, environment and labels of an image."""
        inspected = json.loads(self.run("buildah", "inspect", "--type", "image", image))
        return dict(inspected["Docker"]["config"])

    def layers(self, image: str) -> list[int]:
        """The sizes of an image's layers in bytes, uncompressed, the last one last."""
        inspected = json.loads(self.run("buildah", "inspect", "--type", "image", image))
        return [layer["size"] for layer in json.loads(inspected["Manifest"])["layers"]]

    def size(self, image: str) -> str:
        """The size as `buildah images` tells it."""
        return self.run("buildah", "images", "--format", "{{.Size}}", image).splitlines()[0]

    @contextmanager
    def running(
        self,
        image: str,
        *command: str,
        environment: Mapping[str, str] | None = None,
        files: Mapping[str, str] | None = None,
    ) -> Iterator[Container]:
        """The image as a container of runc: not root, no capabilities, a read-only root file system, `/tmp`.

        Args:
            image: its name.
            command: instead of the image's own.
            environment: beside the image's own.
            files: further files, by their path in the container.
        """
        name = f"robot-offload-test-{os.getpid()}"
        bundle = self.folder / "tmp" / name
        with self.mounted(image) as root:
            shutil.rmtree(bundle, ignore_errors=True)
            bundle.mkdir()
            _write_bundle(bundle, root, self.configuration(image), command, environment or {}, files or {})
            log = bundle / "log"
            with log.open("wb") as output:
                process = subprocess.Popen(
                    ("runc", "run", "--bundle", str(bundle), name),
                    stdin=subprocess.DEVNULL,
                    stdout=output,
                    stderr=output,
                )
            try:
                yield Container(name, process, log)
            finally:
                subprocess.run(("runc", "delete", "--force", name), check=False, capture_output=True)
                process.wait(WAIT_S)
                shutil.rmtree(bundle)


class Container:
    """A running container."""

    def __init__(self, name: str, process: subprocess.Popen[bytes], log: Path) -> None:
        self.name = name
        self.process = process
        self._log = log
        self.until(lambda: self._state() == "running")

    def until(self, happened: Callable[[], bool]) -> None:
        """Waits; a container that has ended, or a wait without end, fails with what it has said."""
        deadline = time.monotonic() + WAIT_S
        while not happened():
            assert self.process.poll() is None, f"ended with {self.process.returncode}: {self.said()}"
            assert time.monotonic() < deadline, f"waited in vain: {self.said()}"
            time.sleep(0.2)

    def said(self) -> str:
        """The last lines of its output."""
        return self._log.read_text(errors="replace")[-3000:]

    def run(self, *command: str) -> subprocess.CompletedProcess[str]:
        """Runs a program in the container, as its user."""
        return subprocess.run(
            ("runc", "exec", "--user", "1000:1000", self.name, *command),
            text=True,
            capture_output=True,
            check=False,
            timeout=WAIT_S,
        )

    def end(self) -> int:
        """What a kubelet does: SIGTERM to process 1; the exit code of the container."""
        self.signal("TERM")
        return self.process.wait(WAIT_S)

    def signal(self, name: str) -> None:
        """Sends process 1 a signal."""
        subprocess.run(("runc", "kill", self.name, name), check=True)

    def _state(self) -> str:
        asked = subprocess.run(("runc", "state", self.name), capture_output=True, text=True, check=False)
        return str(json.loads(asked.stdout)["status"]) if asked.returncode == 0 else ""


def _write_bundle(
    bundle: Path,
    root: Path,
    image: Mapping[str, Any],
    command: tuple[str, ...],
    environment: Mapping[str, str],
    files: Mapping[str, str],
) -> None:
    """runc's own default specification, with the image's configuration and fewer rights."""
    subprocess.run(("runc", "spec", "--bundle", str(bundle)), check=True)
    path = bundle / "config.json"
    spec = json.loads(path.read_text())
    user, group = (int(part) for part in str(image["User"]).split(":"))
    spec["process"] |= {
        "terminal": False,
        "user": {"uid": user, "gid": group},
        "args": [*image["Entrypoint"], *(command or image["Cmd"])],
        "cwd": image.get("WorkingDir") or "/",
        "env": [*image["Env"], *(f"{name}={value}" for name, value in environment.items())],
        "capabilities": {key: [] for key in spec["process"]["capabilities"]},
        "noNewPrivileges": True,
    }
    spec["root"] = {"path": str(root), "readonly": True}
    options = ["nosuid", "nodev", "mode=1777"]
    spec["mounts"].append({"destination": "/tmp", "type": "tmpfs", "source": "tmpfs", "options": options})
    for number, (destination, text) in enumerate(files.items()):
        source = bundle / f"file{number}"
        source.write_text(text, encoding="utf-8")
        # They are under /tmp: runc cannot make the place for a mount on a read-only root.
        mount = {"destination": destination, "type": "bind", "source": str(source), "options": ["bind", "ro"]}
        spec["mounts"].append(mount)
    path.write_text(json.dumps(spec))


@contextmanager
def machine(*stages: Stage) -> Iterator[Machine]:
    """A machine with the base; one test run at a time has it."""
    need()
    folder = wheels_base.cache_folder() / "test"
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        # Of a run that was killed.
        shutil.rmtree(folder / "tmp", ignore_errors=True)
        (folder / "tmp").mkdir()
        (folder / "storage.conf").write_text(
            f'[storage]\ndriver = "overlay"\ngraphroot = "{folder}/root"\nrunroot = "{folder}/run"\n'
        )
        found = Machine(folder)
        found.run("buildah", "rm", "--all", check=False)
        found.base(*stages)
        try:
            yield found
        finally:
            found.run("buildah", "rm", "--all", check=False)


def figure(name: str, value: str) -> None:
    """One line for people; nothing is asserted about times and sizes."""
    sys.stdout.write(f"figure: images: {name} = {value}\n")


def robot_offload(*arguments: str) -> tuple[str, ...]:
    """Our own command line."""
    return (sys.executable, "-m", "robot_offload", *arguments)
