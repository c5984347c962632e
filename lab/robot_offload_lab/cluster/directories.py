"""Where clusters keep their files: a named cluster until it is taken down, that of a test run until the run ends."""

from __future__ import annotations

import fcntl
import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from robot_offload_lab.cluster import processes, programs
from robot_offload_lab.cluster.errors import ClusterError

PREFIX = "robot-offload-cluster-"


def named(name: str) -> Path:
    """Return the directory of a cluster that was started by hand.

    Raises:
        ClusterError: The name is not a plain word.
    """
    if not re.fullmatch(r"[a-z0-9][a-z0-9-]{0,30}", name):
        raise ClusterError(f"{name!r} is not a valid name of a cluster: use up to 31 of a-z, 0-9 and -")
    return all_named() / name


def all_named() -> Path:
    """Return the directory that holds one directory per named cluster."""
    base = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    return Path(base) / "robot-offload" / "clusters"


@contextmanager
def of_this_run() -> Iterator[Path]:
    """Yield a directory that is removed with the test run; leftovers of a killed run go when the next one begins."""
    programs.cache().mkdir(parents=True, exist_ok=True)
    with (programs.cache() / "runs.lock").open("w") as gate:
        fcntl.flock(gate, fcntl.LOCK_EX)  # no sweep happens between the next two lines of another run
        sweep(Path(tempfile.gettempdir()))
        home = Path(tempfile.mkdtemp(prefix=PREFIX))
        life = (home / "life").open("w")
        fcntl.flock(life, fcntl.LOCK_EX)  # the kernel drops it when this process ends, however it ends
    try:
        yield home / "plane"
    finally:
        processes.kill(home)
        shutil.rmtree(home, ignore_errors=True)
        life.close()


def sweep(parent: Path) -> list[Path]:
    """Remove the directories and processes of test runs that no longer exist.

    Args:
        parent: Where runs keep their directories.

    Returns:
        What was removed.
    """
    removed = []
    for home in parent.glob(f"{PREFIX}*"):
        if home.stat().st_uid != os.getuid():
            continue
        with (home / "life").open("a") as life:
            try:
                fcntl.flock(life, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue  # its run is alive
            processes.kill(home)
            shutil.rmtree(home)
            removed.append(home)
    return removed
