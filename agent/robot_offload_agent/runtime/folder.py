"""The runtime folder: sockets, pid files and the collector's memory, out of reach of other users."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from robot_offload_agent.errors import ConfigurationError


def prepare(folder: Path) -> None:
    """Make the runtime folder, or check the one that exists.

    Raises:
        ConfigurationError: it cannot be made, or another user could exchange its content.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        for path in (folder.resolve(), *folder.resolve().parents):
            _check(path)
    except OSError as error:
        raise ConfigurationError(f"parameter runtime_dir: {folder} cannot be used: {error.strerror}") from error


def _check(path: Path) -> None:
    found = path.stat()
    if found.st_uid not in (0, os.geteuid()):
        raise ConfigurationError(
            f"parameter runtime_dir: {path} belongs to user {found.st_uid}, who could speak for the agent; "
            "remove it, or give another folder"
        )
    ours = found.st_gid in (0, os.getegid())
    open_to_others = found.st_mode & stat.S_IWOTH or (found.st_mode & stat.S_IWGRP and not ours)
    # With the sticky bit no user can exchange another's files. A container's mounts are its own.
    if open_to_others and not found.st_mode & stat.S_ISVTX and not path.is_mount():
        raise ConfigurationError(
            f"parameter runtime_dir: other users may write to {path} (mode {stat.S_IMODE(found.st_mode):04o}); "
            f"remove it or run `chmod go-w {path}`, or give another folder"
        )
