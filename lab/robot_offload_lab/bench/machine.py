"""The machine of a measurement: its class, versions, and how busy it was besides."""

from __future__ import annotations

import datetime
import os
import platform
import subprocess
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path
from typing import Any, Final

PACKAGES: Final = {"ros-jazzy-rclpy": "rclpy (Jazzy)", "eclipse-zenoh": "Zenoh", "robot-offload": "Robot Offload"}


def describe() -> dict[str, Any]:
    """Return cores, processor, memory, system and versions."""
    return {
        "cores": os.cpu_count(),
        "processor": _field(Path("/proc/cpuinfo"), "model name") or platform.machine(),
        "memory_gb": round(int((_field(Path("/proc/meminfo"), "MemTotal") or "0").split()[0]) / 1e6),
        "system": f"{platform.system()} {platform.release()}",
        "python": platform.python_version(),
        "versions": _versions(),
    }


def words(known: Mapping[str, Any]) -> str:
    """Return the result of `describe` in one line."""
    versions = ", ".join(f"{name} {version}" for name, version in known["versions"].items())
    return (
        f"{known['cores']} cores ({known['processor']}), {known['memory_gb']} GB, {known['system']}, "
        f"Python {known['python']}, {versions}"
    )


def commit() -> str:
    """Return the commit of this clone, or else the version."""
    done = subprocess.run(
        ["git", "-C", str(Path(__file__).parent), "rev-parse", "--short", "HEAD"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    return done.stdout.strip() or metadata.version("robot-offload")


def load() -> float:
    """Return the number of processes that ran or waited to run, averaged over the last minute."""
    return os.getloadavg()[0]


def today() -> str:
    """Return the date, for the page."""
    return datetime.datetime.now(tz=datetime.UTC).strftime("%Y-%m-%d")


def _versions() -> Mapping[str, str]:
    found = {}
    for package, name in PACKAGES.items():
        try:
            found[name] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    return found


def _field(path: Path, name: str) -> str:
    """Return the first `name : value` of a file of the kernel; empty when there is none."""
    for line in path.read_text().splitlines():
        key, _, value = line.partition(":")
        if key.strip() == name:
            return value.strip()
    return ""
