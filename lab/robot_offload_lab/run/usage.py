"""Processor time of the programs of a run, with all their children."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass

import psutil

from robot_offload_lab.wire.loop import steady_s


@dataclass(frozen=True)
class ProcessorTime:
    """Processor time used so far.

    Attributes:
        t_s: when it was read, steady clock.
        used_s: seconds of one core, by program.
        idle_s: idle seconds of the machine's cores, summed over all cores.
    """

    t_s: float
    used_s: Mapping[str, float]
    idle_s: float


def read(pids: Mapping[str, int]) -> ProcessorTime:
    """Return what the programs have used so far; programs that have ended are left out."""
    used_s = {}
    for name, pid in pids.items():
        with suppress(psutil.Error):
            program = psutil.Process(pid)
            family = (program, *program.children(recursive=True))
            used_s[name] = sum(sum(member.cpu_times()[:2]) for member in family)
    return ProcessorTime(steady_s(), used_s, psutil.cpu_times().idle)


def percent(before: ProcessorTime, after: ProcessorTime) -> dict[str, float]:
    """Return the share of one core that each program used between two readings, percent."""
    elapsed_s = max(after.t_s - before.t_s, 1e-3)
    both = before.used_s.keys() & after.used_s.keys()
    return {name: round(100.0 * (after.used_s[name] - before.used_s[name]) / elapsed_s, 1) for name in sorted(both)}


def busy_share(before: ProcessorTime, after: ProcessorTime) -> float:
    """Return the share of all cores that was in use between two readings, by any program, 0..1."""
    elapsed_s = max(after.t_s - before.t_s, 1e-3) * (psutil.cpu_count() or 1)
    return min(1.0, max(0.0, 1.0 - (after.idle_s - before.idle_s) / elapsed_s))
