"""Threads whose name the system knows too: `top -H` and measurements show them separately."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

NAME_LENGTH = 15
"""The kernel keeps no more (TASK_COMM_LEN)."""


def start(name: str, run: Callable[[], None]) -> None:
    """Start a thread that ends with the process."""

    def named() -> None:
        with suppress(OSError):
            Path(f"/proc/self/task/{threading.get_native_id()}/comm").write_text(name[:NAME_LENGTH])
        run()

    threading.Thread(target=named, name=name, daemon=True).start()
