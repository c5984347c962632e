"""Which release of the agent this is."""

from __future__ import annotations

import re
import sys
from functools import cache
from pathlib import Path

_METADATA = re.compile(r"robot_offload_agent-([^-]+)(-py[\d.]+)?\.(dist|egg)-info")


@cache
def release() -> str:
    """Return the agent's version, e.g. 0.1.0; "" if the agent is not installed as a package.

    It is read from the name of the installation's folder. The standard library reads it from a file in that folder,
    with parsers of mails and archives, which take 3 MB.
    """
    for folder in sys.path:
        for found in sorted(Path(folder or ".").glob("robot_offload_agent-*-info")):
            match = _METADATA.fullmatch(found.name)
            if match is not None:
                return match[1]
    return _described()


def _described() -> str:
    """Return the version in the metadata, for a folder without one in its name (`colcon --symlink-install`)."""
    from importlib.metadata import PackageNotFoundError, version  # noqa: PLC0415 - see release

    try:
        return version("robot-offload-agent")
    except PackageNotFoundError:
        return ""
