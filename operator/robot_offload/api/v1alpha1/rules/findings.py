"""What the checks have in common: their type, and findings of one pattern."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TypeAlias

from robot_offload.api.v1alpha1.robotoffload import RobotOffloadSpec
from robot_offload.findings import Finding

Check: TypeAlias = Callable[[RobotOffloadSpec], Iterator[Finding]]


def repeated(named: list[tuple[str, str]], reason: str, problem: str) -> Iterator[Finding]:
    """A finding for each (path, name) whose name has stood in the list before."""
    first: dict[str, str] = {}
    for path, name in named:
        if name in first:
            yield Finding(path, reason, f"{name!r} {problem} (first at {first[name]})")
        first.setdefault(name, path)
