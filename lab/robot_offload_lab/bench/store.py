"""The folder of a bench: `results.json`, and one CSV file with the raw samples of each group and priority.

Groups can be measured one by one and at different times: each replaces its own part of the results only.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from robot_offload.errors import InputError
from robot_offload_lab.bench import results
from robot_offload_lab.bench.plan import Amounts
from robot_offload_lab.bench.results import GroupResult, Priority, Sample

RESULTS: Final = "results.json"


@dataclass(frozen=True)
class Kept:
    """An outcome with the circumstances under which it was measured.

    Attributes:
        date: of the measurement.
        machine: see `machine.describe`.
        load: averages of the machine's load before and after.
        amounts: how much was asked for.
    """

    outcome: GroupResult
    date: str
    machine: dict[str, Any]
    load: tuple[float, float]
    amounts: Amounts


class Store:
    """Reads and writes the folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @property
    def path(self) -> Path:
        """The results."""
        return self.folder / RESULTS

    def put(self, kept: Kept) -> None:
        """Writes an outcome in the place of an earlier one of the same group and priority."""
        self.folder.mkdir(parents=True, exist_ok=True)
        outcome = kept.outcome
        document = self.document()
        document["groups"].setdefault(outcome.group, {})[outcome.priority] = {
            "date": kept.date,
            "machine": kept.machine,
            "load": [round(value, 2) for value in kept.load],
            "amounts": asdict(kept.amounts),
            **results.to_json(outcome),
        }
        part = self.path.with_suffix(".part")
        part.write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")
        part.replace(self.path)
        _write_csv(self._csv(outcome.group, outcome.priority), outcome.samples)

    def document(self) -> dict[str, Any]:
        """Returns the results as they stand; without any when nothing was measured yet.

        Raises:
            InputError: the file is not of this schema.
        """
        if not self.path.exists():
            return {"schema": results.SCHEMA, "groups": {}}
        try:
            document: dict[str, Any] = json.loads(self.path.read_text(encoding="utf-8"))
            schema = document["schema"]
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise InputError(f"{self.path}: holds no results of a bench: {error}; give another --out") from error
        if schema != results.SCHEMA:
            raise InputError(f"{self.path}: has the schema {schema!r}, not {results.SCHEMA!r}; give another --out")
        return document

    def all(self) -> tuple[Kept, ...]:
        """Returns everything measured so far, with samples."""
        found = []
        for group, by_priority in self.document()["groups"].items():
            for priority in results.PRIORITIES:
                if priority in by_priority:
                    found.append(self._kept(group, priority, by_priority[priority]))
        return tuple(found)

    def _kept(self, group: str, priority: Priority, values: dict[str, Any]) -> Kept:
        outcome = results.from_json(group, priority, values)
        samples = _read_csv(self._csv(group, priority))
        before, after = values["load"]
        return Kept(
            outcome=GroupResult(group, priority, outcome.figures, outcome.parts, samples),
            date=values["date"],
            machine=values["machine"],
            load=(before, after),
            amounts=Amounts(**values["amounts"]),
        )

    def _csv(self, group: str, priority: Priority) -> Path:
        return self.folder / f"{group}-{priority}.csv"


def _write_csv(path: Path, samples: Sequence[Sample]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        if samples:
            writer = csv.DictWriter(file, list(samples[0]))
            writer.writeheader()
            writer.writerows(samples)


def _read_csv(path: Path) -> tuple[Sample, ...]:
    """Numbers as numbers, everything else as text, nothing for an empty field."""
    if not path.exists():
        return ()
    with path.open(newline="", encoding="utf-8") as file:
        return tuple({key: _value(text) for key, text in row.items()} for row in csv.DictReader(file))


def _value(text: str) -> float | str | None:
    if not text:
        return None
    try:
        return float(text)
    except ValueError:
        return text
