"""Which release of the agent this is."""

from __future__ import annotations

from functools import cache
from importlib.metadata import PackageNotFoundError, version


@cache
def release() -> str:
    """Returns the agent's version, e.g. 0.1.0; "" where the agent is not installed as a package."""
    try:
        return version("robot-offload-agent")
    except PackageNotFoundError:
        return ""
