"""Reports, by topic, output messages that did not get from one process of the agent to the next."""

from __future__ import annotations

from collections import Counter
from typing import Protocol

from robot_offload_agent.runtime.bus import Bus
from robot_offload_agent.runtime.parcels import LARGEST_BYTES

MEGABYTE = 1e6


class Process(Protocol):
    """A process with counters and problems for diagnostics."""

    counters: Counter[str]

    def note(self, key: str, problem: tuple[str, str] | None) -> None:
        """Keep or clear a problem for diagnostics."""


def report(bus: Bus, process: Process) -> None:
    """Count messages given up for newer ones; report those that were too large, which stays a problem."""
    for topic, count in bus.losses().items():
        process.counters[f"{topic}.given_up"] = count
    for topic, size in bus.too_large.items():
        message = (
            f"A message of {topic} has {size / MEGABYTE:.1f} MB, more than the {LARGEST_BYTES / MEGABYTE:.1f} MB that "
            "an output may have: make it smaller, or keep the topic on one side"
        )
        process.note(f"large {topic}", ("MessageTooLarge", message))
