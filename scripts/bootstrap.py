#!/usr/bin/env python3
"""Makes the virtual environment `.venv` with everything the project needs, on any machine with a Python 3.

Runs under whatever `python3` there is (3.8 or newer). Finds a CPython 3.12 (the only version the ROS 2 wheels
exist for), makes `.venv`, and installs the pinned requirements and the six packages of this repository with uv.
uv itself is taken from PATH or installed with pip into the cache. A second run with unchanged pins does nothing.
"""

import fcntl
import hashlib
import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv"
REQUIREMENTS = ROOT / "requirements" / "all.txt"
PACKAGES = ("core", "operator", "agent", "lab", "sim", "state")
UV = "uv==0.13.8"
HELP = """\
CPython 3.12 was not found, and the ROS 2 wheels exist for no other version.
Install it in one of these ways, then run the same command again:
  uv:      pip install uv && uv python install 3.12
  pyenv:   pyenv install 3.12
  Ubuntu:  apt-get install python3.12 python3.12-venv   (24.04 or newer)
"""


def find_python():
    """Return the path of a working CPython 3.12, or None."""
    homes = [os.environ.get("PYENV_ROOT", ""), str(Path.home() / ".pyenv"), "/opt/pyenv"]
    candidates = [os.environ.get("PYTHON312", ""), shutil.which("python3.12") or "", sys.executable]
    for home in filter(None, homes):
        candidates += sorted(map(str, Path(home).glob("versions/3.12*/bin/python3.12")), reverse=True)
    managed = Path.home() / ".local/share/uv/python"
    candidates += sorted(map(str, managed.glob("cpython-3.12*/bin/python3.12")))
    test = "import sys, venv; sys.exit(sys.version_info[:2] != (3, 12) or sys.implementation.name != 'cpython')"
    for candidate in filter(None, candidates):
        try:
            if subprocess.run([candidate, "-c", test], capture_output=True, check=False).returncode == 0:
                return candidate
        except OSError:
            continue
    return None


def fingerprint():
    """Change when a pin or a package's metadata changes."""
    digest = hashlib.sha256(REQUIREMENTS.read_bytes())
    for package in PACKAGES:
        for name in ("pyproject.toml", "setup.py", "package.xml"):
            path = ROOT / package / name
            digest.update(path.read_bytes() if path.exists() else b"")
    digest.update(str(ROOT).encode())
    return digest.hexdigest()


def uv_on_path():
    """Return the uv on PATH that runs, or None: a shim of pyenv is found there too, and may have no uv behind it."""
    uv = shutil.which("uv")
    try:
        runs = uv is not None and subprocess.run([uv, "--version"], capture_output=True, check=False).returncode == 0
    except OSError:
        return None
    return uv if runs else None


def own_uv(python):
    """Return the path of a uv in the cache; one checkout after the other makes it, once for each version."""
    cache = Path.home() / ".cache" / "robot-offload"
    tools = cache / UV.replace("==", "-")
    uv = tools / "bin" / "uv"
    cache.mkdir(parents=True, exist_ok=True)
    with (cache / "uv.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not uv.exists():
            subprocess.run([python, "-m", "venv", "--clear", str(tools)], check=True)
            subprocess.run([str(tools / "bin" / "pip"), "install", "--quiet", UV], check=True)
    return str(uv)


def install(uv):
    """Install the pins and the packages into VENV with the program `uv`."""
    env = dict(os.environ, VIRTUAL_ENV=str(VENV))
    subprocess.run(
        [uv, "pip", "sync", "--compile-bytecode", "--require-hashes", str(REQUIREMENTS)], check=True, env=env, cwd=ROOT
    )
    editable = [word for package in PACKAGES for word in ("-e", package)]
    command = [uv, "pip", "install", "--no-deps", "--no-build-isolation", *editable]
    subprocess.run(command, check=True, env=env, cwd=ROOT)


def main():
    """Make or refresh the environment; return the exit code."""
    stamp = VENV / "robot-offload.stamp"
    if stamp.exists() and stamp.read_text() == fingerprint():
        return 0
    python = find_python()
    if python is None:
        sys.stderr.write(HELP)
        return 2
    sys.stderr.write("Setting up .venv (once; downloads about 330 MB when nothing is cached)\n")
    uv = uv_on_path() or own_uv(python)
    subprocess.run([uv, "venv", "--quiet", "--clear", "--python", python, str(VENV)], check=True, cwd=ROOT)
    install(uv)
    stamp.write_text(fingerprint())
    return 0


if __name__ == "__main__":
    sys.exit(main())
