"""Whether a message is young enough to pass."""

from __future__ import annotations


def fresh(age_s: float, most_s: float) -> bool:
    """Return whether an age lies within a bound; a negative age is the echo of a beat that this side has not sent."""
    return 0 <= age_s <= most_s
