"""The robot's numbers for its report: counters of all its processes by kind, and the resources that they use."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from robot_offload_core.control.tallies import IN_FLIGHT, LinkTally
from robot_offload_core.fence.token import Site
from robot_offload_core.topics.tallies import GAP_MS

TICKS = os.sysconf("SC_CLK_TCK")
PAGE_KB = os.sysconf("SC_PAGE_SIZE") // 1024
GAPS = re.compile(r"(.+)\.gap_ms\.(\d+)")
THINNED = ("sent", "rate_limited", "thinned", "unsent")
"""Fates of an input's messages on the robot."""
ENDS = ("succeeded", "aborted", "canceled")
NAMES = ("control", "pulse", "data", "collector", "relay")
"""Of the processes; the kernel keeps 15 characters of `ro-robot-collector`."""
PASSED = "passed"
MAX_GAPS = 4
SAME_S = 5.0
"""The collector changes over within this time of the decision: before it when control is silent, else after it."""


def of_link(tally: LinkTally) -> dict[str, Any]:
    """Return the numbers of the link and of the changes."""
    return {
        "beats": [tally.received, tally.lost],
        "latency": [round(tally.latency_sum_ms), *tally.latency],
        "changeovers": [[site, reason, count] for (site, reason), count in sorted(tally.changeovers.items())],
        "losses": [tally.losses, tally.false_alarms, round(tally.silence_ms)],
    }


def gaps(counters: Mapping[str, int], outputs: Iterable[str]) -> dict[str, list[int]]:
    """Return overdue time (ms), sum (ms) and counts by GAP_MS of the time between commands, by rated output."""
    found: dict[str, list[int]] = {}
    for name in outputs:
        counts = [counters.get(f"{name}.gap_ms.{index}", 0) for index in range(len(GAP_MS) + 1)]
        if any(counts) and len(found) < MAX_GAPS:
            found[name] = [counters.get(f"{name}.overdue_ms", 0), counters.get(f"{name}.gap_sum_ms", 0), *counts]
    return found


def topics(counters: Mapping[str, int], inputs: Iterable[str]) -> dict[str, list[int]]:
    """Return how many messages of each input were sent, above its rate, thinned and not taken by the link."""
    found = {name: [counters.get(f"{name}.{word}", 0) for word in THINNED] for name in inputs}
    return dict(sorted(((name, counts) for name, counts in found.items() if any(counts)), key=lambda it: -sum(it[1])))


def refused(counters: Mapping[str, int], outputs: Iterable[str]) -> dict[str, int]:
    """Return how many messages of the cloud the collector has refused, by reason."""
    found: dict[str, int] = {}
    names = set(outputs)
    for key, count in counters.items():
        name, _, reason = key.partition(".cloud.")
        if name in names and reason and reason != PASSED:
            found[reason] = found.get(reason, 0) + count
    return dict(sorted(found.items(), key=lambda it: -it[1]))


def goals(counters: Mapping[str, int], actions: Iterable[str]) -> dict[str, list[int]]:
    """Return how many goals of each action succeeded, were aborted and were canceled."""
    found = {action: [counters.get(f"{action}.{word}", 0) for word in ENDS] for action in actions}
    return {action: counts for action, counts in found.items() if any(counts)}


def changeover(
    last: tuple[float, str, str] | None, silence: tuple[Site, float, float] | None, now_s: float
) -> dict[str, Any] | None:
    """Return the last change of side: to which one, why, how long ago, and the silence around it once that is over.

    Args:
        last: when, to which side, why; None: there was none since the start.
        silence: around the last change that the collector has seen: side, moment, ms; None: not known yet.
        now_s: the present.
    """
    if last is None:
        return None
    at_s, to, reason = last
    same = silence is not None and silence[0].value == to and abs(silence[1] - at_s) <= SAME_S
    gap_ms = silence[2] if silence is not None and same else None
    return {"to": to, "reason": reason, "ago_s": round(now_s - at_s, 1), "gap_ms": gap_ms}


def actions(counters: Mapping[str, int], names: Iterable[str]) -> dict[str, list[int]]:
    """Return, for each action, the goals that a side executes now, those that wait for one, and all restarts."""
    return {name: [counters.get(f"{name}.{word}", 0) for word in IN_FLIGHT] for name in names}


def services(counters: Mapping[str, int], names: Iterable[str]) -> dict[str, int]:
    """Return how many calls of each service are not answered yet."""
    return {name: counters.get(f"{name}.open", 0) for name in names}


def processes(deaths: Mapping[str, int]) -> dict[str, list[int]]:
    """Return processor time (ms), resident memory (kB) and deaths of the supervisor's children, by name.

    Args:
        deaths: by name of the process.
    """
    parent, found = os.getppid(), {}
    try:
        children = Path(f"/proc/{parent}/task/{parent}/children").read_text(encoding="ascii").split()
    except OSError:  # a kernel without the list: this process alone
        children = [str(os.getpid())]
    for child in children:
        try:
            text = Path(f"/proc/{child}/stat").read_text(encoding="utf-8", errors="replace")
        except OSError:
            continue
        comm, _, rest = text.partition("(")[2].rpartition(")")
        fields = rest.split()
        word = comm.rpartition("-")[2]
        name = next((name for name in NAMES if word and name.startswith(word)), word)
        found[name] = [
            (int(fields[11]) + int(fields[12])) * 1000 // TICKS,  # proc(5): utime and stime are fields 14 and 15
            int(fields[21]) * PAGE_KB,
            deaths.get(name, 0),
        ]
    return found
