"""What the image of the operator leaves out is not needed there: nothing that draws, and no typed Kubernetes client."""

from __future__ import annotations

import subprocess
import sys

import pytest

from robot_offload.images.inside import pins
from robot_offload.images.ours import ROOT

# As in the image: no package that draws, and of the Kubernetes client's typed half the two __init__ only.
BLOCKED = """
import re, sys

class Absent:
    def find_spec(self, name, path=None, target=None):
        if re.match(r"(numpy|matplotlib)$|kubernetes(\\.aio)?\\.client\\.(api|models)\\.", name):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Absent())
import robot_offload.%s
"""


@pytest.mark.parametrize("module", ["cli.main", "handlers", "reporter.main"])
def test_operator_reporter_and_command_line_start_with_what_is_in_the_image(module: str) -> None:
    command = (sys.executable, "-c", BLOCKED % module)
    done = subprocess.run(command, text=True, capture_output=True, check=False, timeout=120)
    assert (done.returncode, done.stderr) == (0, "")


def test_the_operators_pins_hold_nothing_that_draws() -> None:
    project = (ROOT / "operator/pyproject.toml").read_text(encoding="utf-8")
    picked = pins.chosen((ROOT / "requirements/all.txt").read_text(encoding="utf-8"), pins.dependencies(project))
    names = {line.split("==")[0] for line in picked.splitlines() if "==" in line and not line.startswith(" ")}
    assert {"kopf", "kubernetes", "aiohttp", "yarl"} <= names
    assert not {"matplotlib", "numpy", "pillow", "ruff", "pytest", "ros-rclpy"} & names
