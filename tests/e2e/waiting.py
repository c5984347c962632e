"""Waiting for a state, never for a time: what was waited for is told when it does not come."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final, TypeVar

Found = TypeVar("Found")
PATIENCE_S: Final = 90.0
"""Generous: the machine may stand still for a moment at any time."""


class NotSeenError(AssertionError):
    """Something did not come to be in time."""


def eventually(
    look: Callable[[], Found],
    what: str,
    *,
    patience_s: float = PATIENCE_S,
    instead: Callable[[], object] | None = None,
    every_s: float = 0.1,
) -> Found:
    """The first true result of `look`.

    Args:
        look: asks for the state.
        what: is waited for, for people.
        patience_s: how long.
        instead: what is there, for the message.
        every_s: pause between two looks.

    Raises:
        NotSeenError: it did not come.
    """
    end_s = time.monotonic() + patience_s
    while True:
        found = look()
        if found:
            return found
        if time.monotonic() > end_s:
            there = instead() if instead else found
            raise NotSeenError(f"waited {patience_s:g} s for {what}; there is {there!r}")
        time.sleep(every_s)
