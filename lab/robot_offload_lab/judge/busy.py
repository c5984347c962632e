"""Whether the computer of a run was too busy to judge time by it. Pure.

Both sides, the link between them and the judge run on one computer here, and a robot has its own. Silence, age and what
was dropped as too old say nothing about the switch where the processes had no processor to be on time with.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from robot_offload_core.words.reasons import Reason
from robot_offload_lab.judge.invariants import Violation
from robot_offload_lab.judge.recording import Recording

TIMING: Final = frozenset({"Gap", "GoalGap", "Lost", "Stale"})
"""Broken promises that a busy computer brings about without us.

`Stale` too: age is counted from the stamp that a node's own thread makes. One that stands still between that and
publishing says something old, and no agent can know.
"""
STARVED: Final = frozenset({Reason.CONTROL_STARVED, Reason.CLOUD_CONTROL_SILENT})
"""What an agent says when its own control process, or that of the other side, does not get its processor."""
STARVED_CHANGES: Final = 5
"""Words of that kind in a run: more than any test's killed processes bring about."""
BUSY_SHARE: Final = 0.9
"""Share of all cores in use: beyond it each process waits for others."""


STOOD_S: Final = 0.1
"""A computer that leaves a waiting process waiting for longer than a lost heartbeat takes: nobody can be on time."""


@dataclass(frozen=True)
class Computer:
    """What the computer did during a run.

    Attributes:
        busy_share: share of all cores that was in use, 0..1; None: not measured.
        stood_s: the longest time for which a process that only waits was not woken.
    """

    busy_share: float | None = None
    stood_s: float = 0.0


UNKNOWN: Final = Computer()
"""Nothing was measured: the agents' own words count alone."""


def busy(recording: Recording, computer: Computer = UNKNOWN) -> str:
    """Return a sentence on why time is not judged in a run; "" when it is."""
    starved = sum(change.reason in STARVED for change in recording.placements)
    found = []
    if starved >= STARVED_CHANGES:
        found.append(f"the agents missed their processor {starved} times")
    if computer.busy_share is not None and computer.busy_share >= BUSY_SHARE:
        found.append(f"{computer.busy_share:.0%} of its cores were in use")
    if computer.stood_s > STOOD_S:
        found.append(f"it stood still for {computer.stood_s * 1e3:.0f} ms")
    return f"This computer was too busy to judge time by it: {', '.join(found)}" if found else ""


def counted(found: Iterable[Violation], why_busy: str) -> tuple[Violation, ...]:
    """Return the violations that count: on a busy computer those of time do not."""
    return tuple(each for each in found if not why_busy or each.kind not in TIMING)
