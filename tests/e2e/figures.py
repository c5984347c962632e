"""The figures of an end-to-end run: printed as they come, kept in a file, shown in a table at the end."""

from __future__ import annotations

import dataclasses
import json
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

OUT: Final = Path(__file__).parents[2] / "out" / "e2e"
RESULTS: Final = OUT / "results.json"


@dataclass(frozen=True, slots=True)
class Figure:
    """One number.

    Attributes:
        story: the test or bench that it comes from.
        name: what was measured.
        value: the number; None: there was nothing to measure, which is no zero.
        unit: of the value, empty for counts.
    """

    story: str
    name: str
    value: float | None
    unit: str

    def line(self) -> str:
        """For people."""
        return f"figure: {self.name} = {shown(self.value)} {self.unit}".rstrip()


_taken: list[Figure] = []
_bench: list[str] = []


def figure(name: str, value: float | None, unit: str = "") -> None:
    """Prints a figure of the running test and keeps it.

    Args:
        name: what was measured, e.g. `apply to pods ready`.
        value: the number; None when there is none.
        unit: its unit, e.g. `s`.
    """
    taken = Figure(_story(), name, value, unit)
    _taken.append(taken)
    tell(taken.line())
    RESULTS.parent.mkdir(parents=True, exist_ok=True)
    RESULTS.write_text(json.dumps({"figures": [dataclasses.asdict(each) for each in _taken]}, indent=2) + "\n")


def tell(line: str) -> None:
    """A line for whoever watches the run; pytest shows it with `-s`, and with a test that fails."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def taken() -> tuple[Figure, ...]:
    """All figures so far, in their order."""
    return tuple(_taken)


def shown(value: float | None) -> str:
    """A number as people read it."""
    if value is None:
        return "-"
    return f"{value:.0f}" if abs(value) >= 100 or value == int(value) else f"{value:.3g}"


@contextmanager
def of(name: str) -> Iterator[None]:
    """Figures within belong to this part of a bench, not to a test."""
    _bench.append(name)
    try:
        yield
    finally:
        _bench.pop()


def _story() -> str:
    """`test_first_drive` of `tests/e2e/test_first_drive.py::test_first_drive (call)`."""
    if _bench:
        return _bench[-1]
    return os.environ.get("PYTEST_CURRENT_TEST", "").partition(" ")[0].rpartition("::")[2]
