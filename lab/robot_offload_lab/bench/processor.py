"""Processor time of the whole machine, as mpstat shows it, and of single processes."""

from __future__ import annotations

import os
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from robot_offload_lab.wire.loop import steady_s

TICKS_PER_S: Final = os.sysconf("SC_CLK_TCK")
_IDLE: Final = slice(3, 5)
"""Of the fields of /proc/stat: idle, and waiting for a disk."""
_COUNTED: Final = 8
"""The fields after these are contained in others."""


@dataclass(frozen=True)
class Reading:
    """Processor time used so far.

    Attributes:
        t_s: when it was read.
        busy, total: of all cores, ticks.
        own_s: of the given processes, seconds.
    """

    t_s: float
    busy: int
    total: int
    own_s: float


def read(pids: Iterable[int]) -> Reading:
    """Return the processor time used until now."""
    fields = [int(word) for word in Path("/proc/stat").read_text().splitlines()[0].split()[1:]][:_COUNTED]
    return Reading(steady_s(), sum(fields) - sum(fields[_IDLE]), sum(fields), sum(_cpu_s(pid) for pid in pids))


def machine_percent(before: Reading, after: Reading) -> float:
    """Return how busy all cores together were: 100 is every core."""
    return 100.0 * (after.busy - before.busy) / max(1, after.total - before.total)


def own_percent(before: Reading, after: Reading) -> float:
    """Return the share of one core that the given processes used, percent."""
    return 100.0 * (after.own_s - before.own_s) / (after.t_s - before.t_s)


def _cpu_s(pid: int) -> float:
    with suppress(OSError):  # it has ended
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / TICKS_PER_S
    return 0.0
