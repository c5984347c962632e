"""The start script of every image, run by a real bash in a folder that stands for the image's root."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from robot_offload.images.dockerfiles import dockerfile
from tests.unit.operator.images import parsed
from tests.unit.operator.images.specs import build_spec


@pytest.fixture
def start(tmp_path: Path) -> Path:
    """The script as the Dockerfile writes it, with the image's folders below `tmp_path`."""
    (command,) = [one for one in parsed.shell_commands(dockerfile(build_spec())) if "robot-offload-node" in one]
    for folder in ("opt", "usr/local/bin"):
        (tmp_path / folder).mkdir(parents=True)
    subprocess.run(["sh", "-c", re.sub(r"(?<=[ \"])/(opt|usr/local)/", rf"{tmp_path}/\1/", command)], check=True)
    script = tmp_path / "usr/local/bin/robot-offload-node"
    assert script.stat().st_mode & 0o777 == 0o755
    return script


def program(root: Path, prefix: str, text: str) -> None:
    """An executable `server` of package `controller` under a prefix."""
    path = root / prefix / "lib/controller/server"
    path.parent.mkdir(parents=True)
    path.write_text(f"#!/bin/bash\n{text}\n")
    path.chmod(0o755)


def run(script: Path, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Runs the script with nothing else in its environment."""
    environment = {"PATH": "/usr/bin:/bin", "ROS_DISTRO": "jazzy"} | environment
    return subprocess.run([script, *arguments], env=environment, text=True, capture_output=True, check=False)


def test_any_program_is_started_as_it_is(start: Path) -> None:
    assert run(start, "printf", "%s|", "a b", "$HOME", "*").stdout == "a b|$HOME|*|"


def test_the_installation_is_sourced_before_the_overlay(start: Path, tmp_path: Path) -> None:
    for path, name in (("opt/ros/jazzy/setup.bash", "ros"), ("opt/overlay/local_setup.bash", "overlay")):
        (tmp_path / path).parent.mkdir(parents=True)
        (tmp_path / path).write_text(f'export SEEN="$SEEN {name}"\n')
    assert run(start, "bash", "-c", "echo $SEEN").stdout == "ros overlay\n"


def test_ros2_run_becomes_the_node_itself_so_that_it_gets_the_signals(start: Path, tmp_path: Path) -> None:
    program(tmp_path, "overlay", 'echo "$$" "$PPID" "$@"')
    prefixes = f"/nowhere:{tmp_path}/overlay"
    environment = {"PATH": "/usr/bin:/bin", "ROS_DISTRO": "jazzy", "AMENT_PREFIX_PATH": prefixes}
    process = subprocess.Popen(
        [start, "ros2", "run", "controller", "server", "--ros-args", "-p", "a:=b c"],
        env=environment,
        text=True,
        stdout=subprocess.PIPE,
    )
    out, _ = process.communicate(timeout=60)
    assert out.split()[0] == str(process.pid), "the node is a child: nobody would pass signals on to it"
    assert out.split(maxsplit=2)[2] == "--ros-args -p a:=b c\n"


def test_the_first_prefix_wins_as_with_ros2_run(start: Path, tmp_path: Path) -> None:
    program(tmp_path, "one", "echo one")
    program(tmp_path, "two", "echo two")
    done = run(start, "ros2", "run", "controller", "server", AMENT_PREFIX_PATH=f"{tmp_path}/two:{tmp_path}/one")
    assert done.stdout == "two\n"


def test_what_is_not_there_is_left_to_ros2_itself(start: Path) -> None:
    done = run(start, "ros2", "run", "controller", "missing", AMENT_PREFIX_PATH="/nowhere")
    assert done.returncode == 127
    assert "ros2" in done.stderr


def test_an_exit_code_is_passed_on(start: Path) -> None:
    assert run(start, "bash", "-c", "exit 7").returncode == 7
