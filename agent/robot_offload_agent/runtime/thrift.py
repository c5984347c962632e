"""Saves memory and wake-ups of all processes; set before anything is forked."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import os
import sys

ZENOH_RUNTIME = (
    "(app: (worker_threads: 1), net: (handover: app), acc: (handover: app), rx: (handover: app), tx: (handover: app))"
)
"""One thread for the whole session. By default the wheel has six, which wake each other up for every message."""
M_ARENA_MAX = -8
"""From <malloc.h>."""
ARENAS = 2
"""Heaps of one process. By default glibc gives each thread its own, up to eight for each core, and keeps freed memory
in each."""
COLLECT_AFTER = (20_000, 20, 50)
"""New objects after which the youngest are searched for cycles, and so on. Python's own 700 is soon reached."""


GENERATOR = "rosidl_generator_py.generate_py_impl"
"""Generates code from message definitions. Message packages load it with its grammar (2.7 MB) but work without it."""


def save() -> None:
    """Apply all of it, where the system supports it and the user has not set it otherwise."""
    sys.modules[GENERATOR] = None  # type: ignore[assignment]  # an import of it fails
    os.environ.setdefault("ZENOH_RUNTIME", ZENOH_RUNTIME)
    gc.set_threshold(*COLLECT_AFTER)
    if "MALLOC_ARENA_MAX" not in os.environ:
        with contextlib.suppress(OSError, AttributeError):  # another C library
            ctypes.CDLL(None).mallopt(M_ARENA_MAX, ARENAS)
