"""Writes the generated files into the repository, or compares them with it."""

from __future__ import annotations

import argparse
import difflib
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from robot_offload.errors import InputError, RobotOffloadError
from scripts.generate.files import generated_files
from scripts.generate.node_graph import GRAPH_FILE, with_nodes
from scripts.generate.rooms import ARCHITECTURE_FILE, with_rooms

_SHOWN_LINES: Final = 20


class OutOfDateError(RobotOffloadError):
    """Generated files differ from what the models say; the message shows where."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return 0 when all is well, 1 when files are out of date, 2 for a wrong folder."""
    parser = argparse.ArgumentParser(prog="python -m scripts.generate", description=__doc__)
    parser.add_argument("--check", action="store_true", help="write nothing; say what is out of date, end with 1")
    parser.add_argument("--root", type=Path, default=Path(), help="the repository (default: this folder)")
    options = parser.parse_args(arguments)
    try:
        run(options.root, check=options.check)
    except RobotOffloadError as error:
        for line in error.lines:
            print(line, file=sys.stderr)  # noqa: T201
        return error.exit_code
    return 0


def run(root: Path, *, check: bool) -> None:
    """Write all generated files below `root`, or compare them.

    Raises:
        InputError: `root` is not this repository.
        OutOfDateError: with `check`, something differs.
    """
    if not (root / "operator" / "robot_offload" / "api").is_dir():
        raise InputError(f"{root.resolve()}: is not the repository of Robot Offload; start in its top folder")
    page = (root / ARCHITECTURE_FILE).read_text(encoding="utf-8")
    files = {**generated_files(), ARCHITECTURE_FILE: with_rooms(page), GRAPH_FILE: with_nodes(root)}
    if check:
        _compare(root, files)
        return
    for name, text in files.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


def _compare(root: Path, files: Mapping[str, str]) -> None:
    problems = []
    for name, text in files.items():
        path = root / name
        present = path.read_text(encoding="utf-8") if path.is_file() else ""
        if present != text:
            difference = list(
                difflib.unified_diff(present.splitlines(), text.splitlines(), name, f"{name} (generated)", lineterm="")
            )
            problems += [*difference[:_SHOWN_LINES], f"{name} is out of date"]
    if problems:
        raise OutOfDateError("\n".join([*problems, "Run `make generate` and commit the result"]))
