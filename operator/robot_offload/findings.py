"""The finding of a check: where, why (one word for machines) and what to do (one sentence for people)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Severity = Literal["error", "warning"]


@dataclass(frozen=True)
class Finding:
    """One problem of one specification.

    Attributes:
        path: the field as it is written in YAML, e.g. `spec.nodes[1].name`; empty: the whole document.
        reason: one CamelCase word; it becomes the reason of a condition, so it must not change.
        message: one line with the problem and what to write instead.
        severity: an `error` refuses the specification, a `warning` is only reported.
    """

    path: str
    reason: str
    message: str
    severity: Severity = "error"

    def line(self) -> str:
        """Return the finding as one line of text: `spec.nodes[1].name: message`."""
        return f"{self.path}: {self.message}" if self.path else self.message
