"""What the image of the operator leaves out is not needed there: nothing that draws, and no typed Kubernetes client."""

from __future__ import annotations

import subprocess
import sys

import pytest

from robot_offload.images.inside import pins
from robot_offload_lab.images.ours import ROOT

# As in the image: nothing that draws, no core, agent or lab; of the Kubernetes client's typed half the __init__ only.
BLOCKED = """
import re, sys

class Absent:
    def find_spec(self, name, path=None, target=None):
        drawing = r"(numpy|matplotlib|psutil|nicegui|fastapi|uvicorn|robot_offload_(core|agent|lab))$"
        if re.match(drawing, name) or re.match(
            r"kubernetes(\\.aio)?\\.client\\.(api|models)\\.", name
        ):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Absent())
import robot_offload.%s
"""


@pytest.mark.parametrize("module", ["cli.main", "handlers", "runtime.triggers", "reporter.main"])
def test_operator_reporter_and_command_line_start_with_what_is_in_the_image(module: str) -> None:
    command = (sys.executable, "-c", BLOCKED % module)
    done = subprocess.run(command, text=True, capture_output=True, check=False, timeout=120)
    assert (done.returncode, done.stderr) == (0, "")


def test_the_operators_pins_hold_nothing_that_draws() -> None:
    project = (ROOT / "operator/pyproject.toml").read_text(encoding="utf-8")
    roots = pins.dependencies(project, "operator")
    picked = pins.chosen((ROOT / "requirements/all.txt").read_text(encoding="utf-8"), roots)
    names = {line.split("==")[0] for line in picked.splitlines() if "==" in line and not line.startswith(" ")}
    assert {"kopf", "kubernetes", "aiohttp", "yarl"} <= names
    assert not {"matplotlib", "numpy", "pillow", "psutil", "ruff", "pytest", "ros-rclpy", "nicegui"} & names


def test_without_the_lab_its_commands_say_how_to_install_it() -> None:
    program = BLOCKED % "cli.main" + "robot_offload.cli.main.app(['demo', '--mode', 'cloud-only'])"
    done = subprocess.run((sys.executable, "-c", program), text=True, capture_output=True, check=False, timeout=120)
    assert (done.returncode, "pip install robot-offload-lab" in done.stderr) == (2, True), done.stderr


@pytest.mark.parametrize("words", ["['console']", "['console', 'out/demo']"])
def test_without_the_extra_the_console_says_how_to_install_it(words: str) -> None:
    program = BLOCKED % "cli.main" + f"robot_offload.cli.main.app({words})"
    done = subprocess.run((sys.executable, "-c", program), text=True, capture_output=True, check=False, timeout=120)
    said = "robot-offload console serves pages to a browser: pip install 'robot-offload[console]'"
    assert (done.returncode, said in done.stderr) == (2, True), done.stderr
