"""What `make bench-see` prints and keeps: one figure a line."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class SeeFigure:
    """One figure.

    Attributes:
        name: what was measured.
        value: the number; None: it could not be measured.
        unit: of the number.
        aim: what was asked for, in words; empty: nothing was.
    """

    name: str
    value: float | None
    unit: str
    aim: str = ""

    @property
    def text(self) -> str:
        """The number with its unit."""
        return "not measured" if self.value is None else f"{self.value:.4g} {self.unit}"
