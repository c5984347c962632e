"""The specifications to read: files, folders with files in them, and standard input."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from robot_offload.api.files import read_text
from robot_offload.api.v1alpha1 import KIND
from robot_offload.errors import InputError

STANDARD_INPUT: Final = "-"
SUFFIXES: Final = (".yaml", ".yml", ".json")


@dataclass(frozen=True, slots=True)
class Source:
    """One text to read.

    Attributes:
        name: its name in messages.
        text: its content.
    """

    name: str
    text: str


def sources(names: Sequence[str]) -> list[Source]:
    """Return the texts that `names` stand for, in their order; those of a folder sorted by name.

    A file in a folder counts only if it holds a RobotOffload: other objects may lie beside it.

    Raises:
        InputError: a file cannot be read, or a folder holds no RobotOffload.
    """
    return [source for name in names for source in _of(name)]


def _of(name: str) -> Iterator[Source]:
    if name == STANDARD_INPUT:
        yield Source("standard input", sys.stdin.read())
        return
    path = Path(name)
    if not path.is_dir():
        yield Source(name, read_text(path))
        return
    files = sorted(file for file in path.rglob("*") if file.suffix in SUFFIXES and file.is_file())
    found = [source for source in (Source(str(file), read_text(file)) for file in files) if KIND in source.text]
    if not found:
        raise InputError(f"{path}: there is no {KIND} in this folder ({', '.join(SUFFIXES)})")
    yield from found
