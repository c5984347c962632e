"""Measurements as lines of a CSV file: in the folder of a run, and as published in docs/benchmarks.csv.

A line is a figure or a distribution with its circumstances. A group that is measured again replaces only its own lines
of the same form and priority.
"""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

from robot_offload.errors import InputError
from robot_offload_lab.bench.plan import Form
from robot_offload_lab.bench.results import Distribution, Figure, GroupResult

Row = dict[str, str]
FILE: Final = "benchmarks.csv"
COLUMNS: Final = (
    "group", "priority", "form", "name", "title", "conditions", "count", "value", "unit", "must", "aim", "at_least",
    "kept", "baseline", "against", "ratio", "p50", "p90", "p99", "highest", "note", "date", "commit", "machine", "load",
)  # fmt: skip


@dataclass(frozen=True)
class Circumstances:
    """The circumstances under which a group was measured.

    Attributes:
        form: how much was measured.
        date: of the measurement.
        commit: commit of the clone, or else the version.
        machine: see `machine.words`.
        load: averages of the machine's load before and after.
    """

    form: Form
    date: str
    commit: str
    machine: str
    load: str


def rows(outcome: GroupResult, under: Circumstances) -> list[Row]:
    """Return the lines of one group."""
    found: tuple[Figure | Distribution, ...] = (*outcome.figures, *outcome.parts)
    return [{**_cells(one), "group": outcome.group, "priority": outcome.priority, **asdict(under)} for one in found]


def _cells(one: Figure | Distribution) -> Row:
    found = dict.fromkeys(COLUMNS, "")
    found |= {name: _cell(value) for name, value in asdict(one).items() if name in COLUMNS}
    if isinstance(one, Figure):
        found["at_least"] = "yes" if one.at_least else ""
        found["kept"] = one.kept
        found["ratio"] = _cell(one.ratio)
        if one.tolerance_ms:
            found["conditions"] += f" (tolerance {one.tolerance_ms} ms)"
    return found


def _cell(value: object) -> str:
    if isinstance(value, float):
        return f"{round(value, 4):g}" if value < 1e5 else f"{value:.0f}"
    return "" if value is None else str(value)


def merged(old: Iterable[Row], new: Sequence[Row]) -> list[Row]:
    """Return the new lines, and the old ones except those of groups measured again in the same form and priority."""
    replaced = {_key(row) for row in new}
    return [*(row for row in old if _key(row) not in replaced), *new]


def _key(row: Row) -> tuple[str, str, str]:
    return row["group"], row["priority"], row["form"]


def read(path: Path) -> list[Row]:
    """Return the lines of a file; none when it does not exist.

    Raises:
        InputError: the file cannot be read, or has other columns.
    """
    if not path.exists():
        return []
    try:
        with path.open(newline="", encoding="utf-8") as file:
            reader = csv.DictReader(file)
            if tuple(reader.fieldnames or ()) != COLUMNS:
                raise InputError(
                    f"{path}: does not have the columns of a bench; restore the file, or name another folder"
                )
            return list(reader)
    except (OSError, ValueError, csv.Error) as error:
        raise InputError(f"{path}: cannot be read: {error}; restore the file, or name another folder") from error


def write(path: Path, found: Iterable[Row]) -> None:
    """Write the lines atomically."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".part")
    with part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS, restval="", lineterminator="\n")
        writer.writeheader()
        writer.writerows(found)
    part.replace(path)


def figures(found: Iterable[Row]) -> Iterator[Row]:
    """Yield the lines that are figures; the others are distributions."""
    return (row for row in found if row["name"])
