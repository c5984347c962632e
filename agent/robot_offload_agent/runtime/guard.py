"""Ensures that one bad message ends no process: its exception is counted and logged once, the next message taken."""

from __future__ import annotations

import logging
from collections.abc import Callable
from types import TracebackType

from robot_offload_core.words.checks import InvariantError

log = logging.getLogger(__name__)


class Guard:
    """A context around the handling of one message.

    Attributes:
        count: messages whose handling failed.
    """

    def __init__(self, is_up: Callable[[], bool] = lambda: True) -> None:
        """`is_up`: False while this process is ending; failures mean nothing then."""
        self.is_up = is_up
        self.count = 0

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: object, error: BaseException | None, _: TracebackType | None) -> bool:
        """Count an exception of a message; let errors of the process itself go on."""
        if not isinstance(error, Exception) or isinstance(error, InvariantError | AssertionError):
            return False
        if self.is_up():
            self.count += 1
            if self.count == 1:
                log.error("A message could not be handled, further ones are only counted", exc_info=error)
        return True
