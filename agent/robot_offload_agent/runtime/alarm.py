"""A timer that another thread can postpone without waking the waiting thread."""

from __future__ import annotations

import contextlib
import ctypes
import os
import select
import time

_ABSOLUTE = 1
"""TFD_TIMER_ABSTIME."""
_NANOSECONDS = 1_000_000_000


class _Times(ctypes.Structure):
    """`struct itimerspec`."""

    _fields_ = [(name, ctypes.c_long) for name in ("again_s", "again_ns", "at_s", "at_ns")]


class Alarm:
    """A timerfd of the steady clock (`clock.now_s`)."""

    def __init__(self) -> None:
        """Make a timer that is not set.

        Raises:
            OSError: the system gives none.
        """
        self._library = ctypes.CDLL(None, use_errno=True)
        self._file = self._library.timerfd_create(time.CLOCK_BOOTTIME, os.O_NONBLOCK | os.O_CLOEXEC)
        if self._file < 0:
            raise OSError(ctypes.get_errno(), "timerfd_create")

    def set(self, at_s: float) -> None:
        """Let the timer expire once at a time, at once if that has passed; this replaces the time set before."""
        at_s, at_ns = divmod(max(1, round(at_s * _NANOSECONDS)), _NANOSECONDS)
        times = _Times(0, 0, at_s, at_ns)
        if self._library.timerfd_settime(self._file, _ABSOLUTE, ctypes.byref(times), None) < 0:
            raise OSError(ctypes.get_errno(), "timerfd_settime")

    def wait(self, longest_s: float) -> bool:
        """Return True as soon as it expires, False after `longest_s` without."""
        rings, _, _ = select.select([self._file], [], [], longest_s)
        with contextlib.suppress(BlockingIOError):  # put off meanwhile
            if rings:
                os.read(self._file, 8)
                return True
        return False

    def close(self) -> None:
        """Close the timer."""
        os.close(self._file)
