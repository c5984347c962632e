"""A promise that was broken: every observer raises the same error."""

from __future__ import annotations


class ViolationError(Exception):
    """An invariant is broken; this ends the stretch."""

    def __init__(self, invariant: str, text: str, at_s: float) -> None:
        super().__init__(f"invariant {invariant}: {text}")
        self.invariant = invariant
        self.text = text
        self.at_s = at_s
