"""What a check finds: where, why (one word for machines) and what to do (one sentence for people)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Severity = Literal["error", "warning"]


@dataclass(frozen=True)
class Finding:
    """One problem of one specification.

    Attributes:
        path: the field as it is written in YAML, e.g. `spec.nodes[1].name`; empty: the whole document.
        reason: one CamelCase word; it becomes the reason of a condition, so it stays stable.
        message: one line that says what is wrong and what to write instead.
        severity: an `error` refuses the specification, a `warning` is only said.
    """

    path: str
    reason: str
    message: str
    severity: Severity = "error"

    def line(self) -> str:
        """Return the finding as one line of text: `spec.nodes[1].name: message`."""
        return f"{self.path}: {self.message}" if self.path else self.message
