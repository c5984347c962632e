"""Text from outside as terminals and pages may show it: it cannot move a cursor or turn the direction of reading."""

from __future__ import annotations

import re
from typing import Final

_SEQUENCES: Final = re.compile(r"\x1b(?:\[[0-?]*[ -/]*[@-~]|\][^\x07\x1b]*(?:\x07|\x1b\\)?|[@-Z\\-_])")
"""Whole escape sequences of terminals (ECMA-48): what is left of a half one would be unreadable."""
_UNSEEN: Final = re.compile(r"[\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ufeff\ud800-\udfff]")
"""Control characters, marks of direction, other ends of lines, and halves of characters."""


def printable(text: str) -> str:
    """Return a text in one line, without escape sequences and with a space for each control character."""
    return _UNSEEN.sub(" ", _SEQUENCES.sub("", text))
