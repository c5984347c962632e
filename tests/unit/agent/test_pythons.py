"""The Python versions that robots have: what is here is run, the rest is checked by a tool that reads the source."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from scripts.generate.support import PYTHONS

ROOT = Path(__file__).resolve().parents[3]
IMPORT_ALL = """
import importlib, json, pathlib, pkgutil, sys
for path in pathlib.Path("agent/robot_offload_agent").rglob("*.py"):
    compile(path.read_text(encoding="utf-8"), str(path), "exec")
import robot_offload_core
for found in pkgutil.walk_packages(robot_offload_core.__path__, "robot_offload_core."):
    importlib.import_module(found.name)
print(json.dumps(list(sys.version_info[:2])))
"""


def interpreters() -> dict[str, str]:
    """Those of the supported versions that start here, by their version."""
    homes = [Path(os.environ.get("PYENV_ROOT", "/opt/pyenv")), Path.home() / ".pyenv"]
    found = {".".join(map(str, sys.version_info[:2])): sys.executable}
    for version in PYTHONS:
        kept = (path for home in homes for path in sorted(home.glob(f"versions/{version}.*/bin/python{version}")))
        for candidate in (*map(str, kept), shutil.which(f"python{version}")):
            if candidate and subprocess.run([candidate, "-V"], capture_output=True, check=False).returncode == 0:
                found.setdefault(version, candidate)
    return found


@pytest.mark.parametrize(("version", "program"), interpreters().items(), ids=lambda value: str(value)[-4:])
def test_every_interpreter_here_imports_the_whole_core_and_compiles_the_agent(version: str, program: str) -> None:
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "core"), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [program, "-W", "error", "-c", IMPORT_ALL]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, env=environment, timeout=240, check=False)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == [int(part) for part in version.split(".")]
    core, agent = PYTHONS[version]
    assert core == "run", "the page of what was tried says less than this test has just shown"
    assert agent in ("run", "compiled")


def test_core_and_agent_use_nothing_newer_than_the_oldest_supported_python() -> None:
    vermin = Path(sys.executable).with_name("vermin")
    command = [vermin, "--no-tips", "--target=3.10-", "--processes=1", "--backport", "typing", "core", "agent"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, timeout=240, check=False)
    assert done.returncode == 0, done.stdout
    assert next(iter(PYTHONS)) == "3.10"
