"""Notifies systemd that the service is ready, lives, or stops (sd_notify(3)).

Without `NOTIFY_SOCKET` in the environment everything here does nothing.
"""

from __future__ import annotations

import contextlib
import os
import socket

WATCHDOG_SHARE = 3
"""Signs of life in one watchdog period; systemd.service(5) asks for two at least."""


class Systemd:
    """The connection to the service manager that started this process."""

    def __init__(self) -> None:
        """Read the environment and remove it, because child processes are not services."""
        address = os.environ.pop("NOTIFY_SOCKET", "")
        period_us = os.environ.pop("WATCHDOG_USEC", "")
        meant_for = os.environ.pop("WATCHDOG_PID", str(os.getpid()))
        self.address = "\0" + address[1:] if address.startswith("@") else address
        self.period_s = 0.0
        if period_us.isdecimal() and meant_for == str(os.getpid()):
            self.period_s = int(period_us) / 1e6 / WATCHDOG_SHARE
        self.due_s = 0.0

    def say(self, *words: str) -> None:
        """Send assignments such as `READY=1` without waiting: a manager that does not read misses them."""
        if not self.address:
            return
        manager = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        with manager, contextlib.suppress(OSError):
            manager.sendto("\n".join(words).encode(), self.address)

    def live(self, now_s: float) -> None:
        """Feed the watchdog when that is due."""
        if self.period_s and now_s >= self.due_s:
            self.due_s = now_s + self.period_s
            self.say("WATCHDOG=1")
