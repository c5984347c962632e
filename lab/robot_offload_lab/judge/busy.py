"""Whether the computer of a run was too busy for judging times. Pure.

Both sides, the link between them and the judge share one computer here; a robot has its own. Silence, age and messages
dropped as too old show nothing about the switch if the processes got no processor time.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from robot_offload_core.words.reasons import Reason
from robot_offload_lab.judge.invariants import Violation
from robot_offload_lab.judge.recording import Recording

TIMING: Final = frozenset({"Gap", "GoalGap", "Lost", "Stale"})
"""Broken promises that a busy computer alone can cause.

`Stale` too: age is counted from the stamp that a node's own thread makes. A thread that stands still between stamping
and publishing publishes an old message, and no agent can know.
"""
STARVED: Final = frozenset({Reason.CONTROL_STARVED, Reason.CLOUD_CONTROL_SILENT})
"""The reasons that an agent gives when its own control process, or the other side's, gets no processor time."""
STARVED_CHANGES: Final = 5
"""Such changes in a run: more than any test's killed processes cause."""
BUSY_SHARE: Final = 0.9
"""Share of all cores in use: beyond it each process waits for others."""
STOOD_S: Final = 0.1
"""A ready process that waits longer than this, more than a lost heartbeat takes, shows that none can be on time."""


@dataclass(frozen=True)
class Computer:
    """What the computer did during a run.

    Attributes:
        busy_share: share of all cores that was in use, 0..1; None: not measured.
        stood_s: the longest time by which the wake-up of a process that only waits was late.
    """

    busy_share: float | None = None
    stood_s: float = 0.0


UNKNOWN: Final = Computer()
"""Nothing was measured: only the agents' own reasons count."""


def busy(recording: Recording, computer: Computer = UNKNOWN) -> str:
    """Return a sentence on why times are not judged in a run; "" when they are."""
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
    """Return the violations that count: on a busy computer those of timing do not."""
    return tuple(each for each in found if not why_busy or each.kind not in TIMING)
