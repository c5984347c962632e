"""`robot-offload pair` on two hosts: what its two folders say is started on each, and the robot has its cloud."""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from pathlib import Path

import pytest

from robot_offload_lab.wire.options import LinkOptions
from robot_offload_lab.wire.two_hosts import CLOUD_ADDRESS, TwoHosts

ROOT = Path(__file__).parents[2]
TALKER = ROOT / "examples" / "talker"
PROGRAMS = Path(sys.executable).parent
PATIENCE_S = 60.0
HOST_OF = {"robot": "robot", "workstation": "cloud"}


class Desk:
    """Starts programs on the two hosts as a person does with a folder's files, and hears the listener."""

    def __init__(self, hosts: TwoHosts, folder: Path, stack: ExitStack) -> None:
        self.hosts, self.folder, self.stack = hosts, folder, stack
        self.heard: list[str] = []

    def command(self, side: str, words: str) -> list[str]:
        """The command line on a host, with the settings of the folder's file `environment`."""
        script = f"set -a; . {self.folder / side / 'environment'}; set +a; exec {words}"
        return [*self.hosts.enter(HOST_OF[side]), "bash", "-c", script]

    def start(self, side: str, words: str) -> subprocess.Popen[str]:
        log = self.stack.enter_context((self.folder / f"{side}-{words.split()[1].rpartition('/')[2]}.log").open("ab"))
        process = subprocess.Popen(
            self.command(side, words), cwd=TALKER, env=environment(), stdout=subprocess.PIPE, stderr=log, text=True
        )
        self.stack.callback(end, process)
        return process

    def listen(self, process: subprocess.Popen[str]) -> None:
        def read() -> None:
            assert process.stdout is not None
            with suppress(ValueError):  # it is closed at the end, maybe between two lines
                for line in process.stdout:
                    if found := re.search(r"from (\w+)", line):
                        self.heard.append(found[1])

        threading.Thread(target=read, daemon=True).start()

    def hears(self, name: str) -> None:
        """Waits until ten lines in a row come from one node."""
        began_s = time.monotonic()
        while set(self.heard[-10:]) != {name} or len(self.heard) < 10:
            assert time.monotonic() - began_s < PATIENCE_S, f"nobody hears {name}: {self.heard[-20:]}"
            time.sleep(0.1)
        self.heard.clear()


def end(process: subprocess.Popen[str]) -> None:
    process.terminate()
    try:
        process.wait(10)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    assert process.stdout is not None
    process.stdout.close()


def environment() -> dict[str, str]:
    return {**os.environ, "PATH": f"{PROGRAMS}:{os.environ['PATH']}", "PYTHONUNBUFFERED": "1", "ROS_DISTRO": "jazzy"}


def agent(folder: Path) -> str:
    """What the folder's unit starts, without the robot's own ROS 2: here its parts are wheels."""
    (unit,) = folder.glob("robot-offload-agent*.service")
    (words,) = re.findall(r"exec (robot-offload-agent .*)'", unit.read_text())
    return str(words)


def replica(folder: Path) -> str:
    """The whole command line that the folder's README gives for the talker."""
    (line,) = re.findall(r"^ *python3 (talker\.py .*)$", (folder / "README.md").read_text(), re.MULTILINE)
    return f"{shlex.quote(sys.executable)} {line}"


@pytest.fixture
def paired() -> Iterator[Path]:
    """Both folders, where they say that they lie."""
    with tempfile.TemporaryDirectory(prefix="pair") as text:
        folder = Path(text)
        places = [f"--{side}-folder={folder / side}" for side in HOST_OF]
        words = ["pair", str(TALKER / "robotoffload.yaml"), "--host", CLOUD_ADDRESS, "-o", text, *places]
        subprocess.run([PROGRAMS / "robot-offload", *words], check=True, stdout=subprocess.DEVNULL)
        for side in HOST_OF:  # systemd makes these two folders
            file = folder / side / "agent.yaml"
            moved = file.read_text().replace("/run/robot-offload/", f"{text}/run-{side}-")
            file.write_text(moved.replace("/var/lib/robot-offload/", f"{text}/lib-{side}-"))
        yield folder


@pytest.mark.core
@pytest.mark.ros
@pytest.mark.skipif(bool(TwoHosts.refusal()), reason=TwoHosts.refusal() or "-")
def test_two_folders_make_a_robot_and_its_workstation_and_the_doctor_compares_them(paired: Path) -> None:
    with ExitStack() as stack:
        hosts = stack.enter_context(TwoHosts(LinkOptions(delay="5ms"), 1))
        desk = Desk(hosts, paired, stack)
        for side in HOST_OF:
            desk.start(side, agent(paired / side))
            desk.start(side, replica(paired / side))
        desk.listen(desk.start("robot", f"{shlex.quote(sys.executable)} listener.py"))
        desk.hears("remote_talker")
        words = f"robot-offload-agent doctor --json --params {paired / 'robot' / 'agent.yaml'}"
        done = subprocess.run(
            desk.command("robot", words), env=environment(), capture_output=True, text=True, check=False
        )
        found = {one["check"]: one for one in json.loads(done.stdout)}
        fine = {name for name, one in found.items() if one["level"] == "ok"}
        assert fine >= {
            "Certificates",
            "CloudUdp",
            "CloudTcp",
            "Releases",
            "Nodes",
            "MessageTypes",
            "SecondPublisher",
        }, found
        hosts.cut("both")
        desk.hears("talker")
        hosts.cut(None)
        desk.hears("remote_talker")
