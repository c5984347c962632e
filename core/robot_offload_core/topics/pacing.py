"""How fast inputs are sent over a link that cannot carry all of them. Pure: time is an argument.

The link refuses messages that would have to wait. Without pacing a camera would come in bursts, and an important topic
would get no larger share. So inputs with a `minRate` are spread evenly at the rate that passes: slower at refusals, the
lowest priority first, and faster again while there are none.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from robot_offload_core.words.declared import Priority

SLOWER = 1.3
"""Factor on the time between two messages at a refusal."""
FASTER = 0.9
"""Factor on that time after each calm stretch: from a third of a rate to the full rate in six seconds."""
CALM_S = 0.5
"""After this long without a refusal the pace rises again."""
REFUSALS_S = 0.3
"""Refusals within this time count once: everything sent before an acknowledgement meets the same full link."""
AVERAGED = 0.1
"""Weight of the newest interval in the usual one."""
ORDER = (Priority.LOW, Priority.NORMAL, Priority.HIGH)


@dataclass
class Pace:
    """The pace of one input.

    Attributes:
        slowest_s: longest time between two messages, from `minRate`; 0: send all as they come.
        priority: of the input.
        least_s: present least time between two messages; 0: send all as they come.
        usual_s: mean time between arriving messages; 0: unknown.
        came_s: when the newest message came; None before the first.
        due_s: when the next one passes.
        changed_s: when `least_s` last changed, or a message was refused.
    """

    slowest_s: float = 0.0
    priority: Priority = Priority.NORMAL
    least_s: float = 0.0
    usual_s: float = 0.0
    came_s: float | None = None
    due_s: float = 0.0
    changed_s: float = float("-inf")

    def passes(self, now_s: float) -> bool:
        """Take a message; return whether it is sent."""
        if not self.slowest_s:
            return True
        if self.came_s is not None:
            came_after_s = min(now_s - self.came_s, self.slowest_s)
            weight = AVERAGED if self.usual_s else 1.0
            self.usual_s += weight * (came_after_s - self.usual_s)
        self.came_s = now_s
        self._relax(now_s)
        if not self.least_s:
            return True
        if now_s < self.due_s - self.usual_s / 2:
            return False
        self.due_s = max(self.due_s, now_s - self.usual_s / 2) + self.least_s
        return True

    def slow(self, now_s: float) -> bool:
        """Lengthen the time between two messages; return whether that was possible."""
        if not self.slowest_s or not self.usual_s or self.least_s >= self.slowest_s:
            return False
        self.least_s = min(self.slowest_s, SLOWER * max(self.least_s, self.usual_s))
        self.changed_s = now_s
        return True

    def _relax(self, now_s: float) -> None:
        if not self.least_s or now_s - self.changed_s < CALM_S:
            return
        self.least_s, self.changed_s = FASTER * self.least_s, now_s
        if self.least_s <= self.usual_s:
            self.least_s = self.due_s = 0.0


class Paces:
    """The paces of all inputs together."""

    def __init__(self, paces: Iterable[tuple[str, Pace]]) -> None:
        self.of = dict(paces)
        self._refused_s = float("-inf")

    def passes(self, name: str, now_s: float) -> bool:
        """Take a message of an input; return whether it is sent."""
        return self.of[name].passes(now_s)

    def refused(self, name: str, now_s: float) -> None:
        """Record that the link refused a message, and thin the lowest priority that can be thinned."""
        own = self.of[name]
        for pace in self.of.values():
            if pace.least_s:
                pace.changed_s = now_s  # not calm
        if now_s - self._refused_s < REFUSALS_S:
            return
        self._refused_s = now_s
        for priority in ORDER[: ORDER.index(own.priority) + 1]:
            same = [pace for pace in self.of.values() if pace.priority is priority]
            # Of its own priority only the refused input is thinned: the others may have a share that passes.
            chosen = [own] if priority is own.priority else same
            slower = [pace.slow(now_s) for pace in chosen]
            if any(slower):
                return
