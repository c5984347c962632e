"""The control groups of a node's pods: made before the kubelet needs them, removed with the node."""

from __future__ import annotations

import time
from pathlib import Path

ROOT = Path("/sys/fs/cgroup")
# A node is a whole machine: at the weight of a single session here, all its pods would starve beside other work.
_WEIGHTS = {"cpu.shares": "16384", "cpu.weight": "1600"}  # 16 times what a session gets
NEEDED = {"cpu", "cpuset", "memory", "pids"}


def unified() -> bool:
    """Return whether the machine has cgroup v2 only."""
    return (ROOT / "cgroup.controllers").exists()


def _hierarchies() -> list[Path]:
    if unified():
        return [ROOT]
    return [path for path in ROOT.iterdir() if path.is_dir() and not path.is_symlink() and path.is_mount()]


def missing() -> set[str]:
    """Return the controllers that a kubelet needs and this machine lacks."""
    if unified():
        return NEEDED - set((ROOT / "cgroup.controllers").read_text().split())
    return {name for name in NEEDED if not (ROOT / name / "tasks").exists()} if ROOT.is_dir() else NEEDED


def make(name: str) -> None:
    """Make the group in every hierarchy."""
    for hierarchy in _hierarchies():
        group = hierarchy / name
        group.mkdir(exist_ok=True)
        if hierarchy == ROOT:
            control = ROOT / "cgroup.subtree_control"
            control.write_text(" ".join(f"+{each}" for each in sorted(NEEDED - set(control.read_text().split()))))
        for setting, value in _WEIGHTS.items():
            if (group / setting).exists():
                (group / setting).write_text(value)
        # Until these are set no process can join the group; later kernels inherit them.
        for setting in ("cpuset.cpus", "cpuset.mems"):
            if (group / setting).exists() and not (group / setting).read_text().strip():
                (group / setting).write_text((hierarchy / setting).read_text())


def left(prefix: str) -> list[Path]:
    """Return the groups whose name has this prefix."""
    return [group for hierarchy in _hierarchies() for group in hierarchy.glob(f"{prefix}*") if group.is_dir()]


def remove(prefix: str, patience: float = 60.0) -> None:
    """Remove the groups whose name has this prefix; their processes have ended or are about to.

    Args:
        prefix: Of their names.
        patience: Seconds after which it gives up.
    """
    deadline = time.monotonic() + patience
    while (groups := left(prefix)) and time.monotonic() < deadline:
        for group in groups:
            inner = sorted((path for path in group.rglob("*") if path.is_dir()), key=lambda path: -len(path.parts))
            for each in (*inner, group):
                try:
                    each.rmdir()
                except OSError:  # a process in it has not ended yet
                    break
        time.sleep(0.02)
