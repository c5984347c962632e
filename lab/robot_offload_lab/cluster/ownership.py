"""Ownership of clusters: a number is taken by a lock, and everything of a cluster by its marker file."""

from __future__ import annotations

import fcntl
import json
import os
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import IO, Any

from robot_offload_lab.cluster import cgroups, kind_docker, netns, network, processes, sysctls
from robot_offload_lab.cluster.errors import ClusterError
from robot_offload_lab.cluster.layout import NUMBERS, STATE, Layout

_BOOT = Path("/proc/sys/kernel/random/boot_id")
PATIENCE = 60.0  # seconds until a killed process's resources are free


@dataclass(frozen=True, slots=True)
class Leftovers:
    """How much of a cluster is still there."""

    processes: int
    mounts: int
    cgroups: int
    netns: int
    interfaces: int
    files: int
    sysctls: int
    containers: int

    def __bool__(self) -> bool:
        return any(astuple(self))


def claim(number: int | None, by_hand: Path | None) -> tuple[Layout, IO[str]]:
    """Take a number, the lowest free one unless one is given, and remove what a killed run left under it.

    Args:
        number: 0 to 9, or None.
        by_hand: Directory of a cluster that outlives this process; None when it ends with the process.

    Returns:
        The layout, and the lock, which this process holds while it lives.

    Raises:
        ClusterError: The number is taken, or what exists under it is not ours.
    """
    _prepare_state()
    taken = []
    for each in NUMBERS if number is None else (number,):
        layout = Layout(each)
        lock = _lock(layout)
        if lock is None:
            taken.append(f"cluster {each} belongs to a run that is alive")
            continue
        if _marked(layout).get("by_hand"):
            lock.close()
            taken.append(f"cluster {each} was started by hand")
            continue
        try:
            remove(layout)
            _mark(layout, by_hand)
        except BaseException:
            lock.close()
            raise
        return layout, lock
    raise ClusterError(f"{'; '.join(taken)}. Next: python -m robot_offload_lab.cluster status")


def remove(layout: Layout) -> None:
    """Remove everything of a cluster, whichever process started it and however that ended.

    Raises:
        ClusterError: Something of this name was not made by a cluster of ours.
    """
    if not layout.marker.exists():
        if strange := [*netns.named(f"{layout.name}-"), *map(str, cgroups.left(f"{layout.name}-"))]:
            raise ClusterError(
                f"These have our names, but no cluster of ours made them: {', '.join(strange)}. "
                f"Next: remove them, or take another number"
            )
        return
    processes.kill(layout.home)
    kind_docker.remove(layout)
    network.remove(layout)
    cgroups.remove(f"{layout.name}-")
    _remove_files(layout.home)
    with _machine_lock():
        if not any(Layout(each).marker.exists() for each in NUMBERS):
            sysctls.put_back()


def leftovers(layout: Layout) -> Leftovers:
    """Count what exists of a cluster."""
    places = (f"{layout.home}/", f"{layout.kept}/")
    names = netns.named(f"{layout.name}-")
    others = any(Layout(each).marker.exists() for each in NUMBERS if each != layout.number)
    mounts = Path("/proc/self/mountinfo").read_text().splitlines()
    return Leftovers(
        processes=len(_processes(places)) + sum(len(netns.inhabitants(name)) for name in names),
        mounts=sum(any(place in line for place in (*places, f"/{layout.name}-")) for line in mounts),
        cgroups=len(cgroups.left(f"{layout.name}-")),
        netns=len(names),
        interfaces=int((netns.INTERFACES / layout.name).exists()),
        files=int(layout.home.exists()),
        sysctls=0 if others else len(sysctls.changed()),  # the last cluster puts them back
        containers=kind_docker.left(layout),
    )


def known() -> list[Layout]:
    """Return the existing clusters, running or left by a killed run."""
    return [Layout(each) for each in NUMBERS if Layout(each).marker.exists()]


def by_hand(directory: Path) -> Layout | None:
    """Return the cluster that was started by hand with this directory."""
    found = (layout for layout in known() if _marked(layout).get("by_hand") == str(directory))
    return next(found, None)


def sweep() -> list[Layout]:
    """Remove what killed runs have left; return the clusters concerned."""
    swept = []
    for layout in known():
        lock = None if _marked(layout).get("by_hand") else _lock(layout)
        if lock is not None:
            with lock:  # until it is gone no process starts another one there
                remove(layout)
            swept.append(layout)
    return swept


def is_alive(layout: Layout) -> bool:
    """Return whether a cluster is in use: by a living run, or started by hand since the machine was booted."""
    if _marked(layout).get("by_hand"):
        return True
    lock = _lock(layout)
    if lock is None:
        return True
    lock.close()
    return False


def _lock(layout: Layout) -> IO[str] | None:
    """Take the lock of a number; return None if another process holds it for more than a moment."""
    lock = (STATE / f"{layout.number}.lock").open("a")
    for _ in range(5):
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            time.sleep(0.02)
        else:
            return lock
    lock.close()
    return None


def _marked(layout: Layout) -> dict[str, Any]:
    """Return the marker's content; empty when it is of an earlier boot, after which only files can be left."""
    try:
        marker: dict[str, Any] = json.loads(layout.marker.read_text())
    except (FileNotFoundError, ValueError):
        return {}
    return marker if marker["boot"] == _BOOT.read_text().strip() else {}


def _mark(layout: Layout, by_hand: Path | None) -> None:
    """Mark everything that follows as ours, before anything exists."""
    name = str(by_hand) if by_hand else None
    marker = {"number": layout.number, "boot": _BOOT.read_text().strip(), "by_hand": name}
    with _machine_lock():
        _remove_files(layout.home)  # of a run that was killed before it could mark it
        layout.home.mkdir(mode=0o700)
        scratch = layout.marker.with_suffix(".partial")
        scratch.write_text(json.dumps(marker))
        scratch.replace(layout.marker)
        sysctls.keep_and_raise()


def _prepare_state() -> None:
    STATE.mkdir(mode=0o700, exist_ok=True)
    if STATE.is_symlink() or STATE.stat().st_uid != os.getuid():
        raise ClusterError(f"{STATE} has another owner. Next: remove it")


@contextmanager
def _machine_lock() -> Iterator[None]:
    """Hold the lock with which one process at a time starts or ends a cluster."""
    with (STATE / "lock").open("a") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def _remove_files(home: Path) -> None:
    """Remove a directory; mounts in it end a moment after their namespace."""
    deadline = time.monotonic() + PATIENCE
    while home.exists():
        shutil.rmtree(home, ignore_errors=time.monotonic() < deadline)
        time.sleep(0.02)


def _processes(places: tuple[str, ...]) -> list[int]:
    found = []
    for entry in Path("/proc").iterdir():
        try:
            if entry.name.isdigit() and int(entry.name) != os.getpid():
                words = (entry / "cmdline").read_text(errors="replace")
                found += [int(entry.name)] if any(place in words for place in places) else []
        except OSError:
            continue
    return found
