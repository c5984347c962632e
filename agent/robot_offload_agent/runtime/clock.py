"""The one place that reads clocks. Steady means CLOCK_BOOTTIME: it goes on while the host sleeps."""

from __future__ import annotations

import time


def now_s() -> float:
    """Return seconds of this host's steady clock. Never compared with another host's."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


def now_us() -> int:
    """Return the same in microseconds."""
    return time.clock_gettime_ns(time.CLOCK_BOOTTIME) // 1000


def wall_us() -> int:
    """Return system clock minus steady clock in us, for the estimate of the offset that user nodes would see."""
    return time.clock_gettime_ns(time.CLOCK_REALTIME) // 1000 - now_us()


def wall_ns() -> int:
    """Return system clock in nanoseconds, for stamps that user nodes see."""
    return time.clock_gettime_ns(time.CLOCK_REALTIME)
