"""Builds what pip installs: `python -m scripts.dist`, also `make dist`. Writes wheels and a constraints file.

With them a robot needs `pip install --constraint constraints.txt robot_offload_core-*.whl robot_offload_agent-*.whl`,
nodes that hand over their state `robot_offload_state-*.whl`, a terminal `robot_offload-*.whl`. The same commit gives
the same bytes.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[1]
PACKAGES: Final = ("core", "agent", "state", "operator", "lab")
CONSTRAINTS: Final = "constraints.txt"
_BUILD: Final = "import sys; from setuptools import build_meta; build_meta.build_wheel(sys.argv[1])"
_PIN: Final = re.compile(r"^([A-Za-z0-9_.-]+==[^\s;\\]+)\s*(;[^\\\n]*)?", re.MULTILINE)
_LEFT_OUT: Final = shutil.ignore_patterns("build", "*.egg-info", "__pycache__")


def main(arguments: list[str] | None = None) -> int:
    """Build the wheels; return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m scripts.dist", description=__doc__)
    parser.add_argument("--output", type=Path, default=ROOT / "dist", help="folder to write to (default: dist)")
    output = parser.parse_args(arguments).output.resolve()
    output.mkdir(parents=True, exist_ok=True)
    for old in output.glob("*.whl"):
        old.unlink()
    for package in PACKAGES:
        wheel(ROOT / package, output)
    pins = constraints((ROOT / "requirements" / "all.txt").read_text(encoding="utf-8"))
    (output / CONSTRAINTS).write_text(pins, encoding="utf-8")
    for path in sorted(output.iterdir()):
        print(path)  # noqa: T201
    return 0


def wheel(package: Path, output: Path) -> None:
    """Build one package with the setuptools of this environment, from a copy: the sources stay as they are."""
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / package.name
        shutil.copytree(package, source, ignore=_LEFT_OUT)
        environment = {**os.environ, "SOURCE_DATE_EPOCH": committed_at()}
        command = [sys.executable, "-c", _BUILD, str(output)]
        subprocess.run(command, cwd=source, env=environment, check=True, stdout=subprocess.DEVNULL)


def committed_at() -> str:
    """Return the time of the last commit in seconds; outside a checkout 1980, the oldest that a wheel can hold."""
    command = ["git", "-C", str(ROOT), "log", "-1", "--format=%ct"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.stdout.strip() or "315532800"


def constraints(requirements: str) -> str:
    """Return the tested versions without their hashes: what pip installs beside the wheels is then what was tested.

    PyYAML is left out, because on a robot it comes with ROS.
    """
    found = [pin[1] + (f" {pin[2].strip()}" if pin[2] else "") for pin in _PIN.finditer(requirements)]
    return "".join(f"{pin}\n" for pin in found if not pin.startswith("pyyaml=="))


if __name__ == "__main__":
    sys.exit(main())
