"""Finds the executable of a ROS package by the ament index, as `ros2 run` does, but without that program."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from robot_offload.errors import InputError

PREFIXES: Final = "AMENT_PREFIX_PATH"
_INDEX: Final = Path("share/ament_index/resource_index/packages")
_MOST_NAMED: Final = 8


class NotInstalledError(InputError):
    """A package, or an executable of it, is not in the sourced workspaces."""


def executable(package: str, name: str, environment: Mapping[str, str]) -> Path:
    """Return the program of a package: `lib/PACKAGE/NAME` under the first prefix whose index has the package.

    Args:
        package: the ROS package, e.g. nav2_controller.
        name: the executable in it, e.g. controller_server.
        environment: holds AMENT_PREFIX_PATH, which a workspace's setup file sets.

    Raises:
        NotInstalledError: no workspace is sourced, or none of them has the package or the executable; names those
            that exist.
    """
    prefixes = [Path(text) for text in environment.get(PREFIXES, "").split(os.pathsep) if text]
    if not prefixes:
        raise NotInstalledError(
            f"{PREFIXES} is empty, so no package can be found; source the setup.bash of your ROS 2 and of your "
            "workspace in this shell, or write a command"
        )
    homes = [prefix for prefix in prefixes if (prefix / _INDEX / package).exists()]
    if not homes:
        raise NotInstalledError(
            f"none of the {len(prefixes)} folders of {PREFIXES} has the package {package!r}; build it, source its "
            "workspace in this shell, or write a command"
        )
    folder = homes[0] / "lib" / package
    if not _runs(folder / name):
        there = sorted(path.name for path in folder.iterdir() if _runs(path)) if folder.is_dir() else []
        named = ", ".join(there[:_MOST_NAMED]) + (", ..." if len(there) > _MOST_NAMED else "")
        raise NotInstalledError(f"{folder} has no executable {name!r}; it has {named or 'none'}")
    return folder / name


def _runs(path: Path) -> bool:
    return path.is_file() and os.access(path, os.X_OK)
