"""The operator's two clocks, handed in so that tests can turn them."""

from __future__ import annotations

import datetime
import time
from collections.abc import Callable
from dataclasses import dataclass


def _wall() -> datetime.datetime:
    return datetime.datetime.now(datetime.UTC)


@dataclass(frozen=True, slots=True)
class Clock:
    """The source of time.

    Attributes:
        steady_s: seconds that never step; for every decision that waits.
        wall: the date, UTC; for people, for certificates and for idle times of minutes.
    """

    steady_s: Callable[[], float] = time.monotonic
    wall: Callable[[], datetime.datetime] = _wall
