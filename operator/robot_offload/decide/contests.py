"""Fights over fields: another controller changes our fields, we take them back, and so on for ever.

Taking a field back a few times is healing. More is a fight that neither side wins and that costs the API server two
writes each time: the operator then pauses longer and longer, and reports the other side.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from robot_offload.decide.ownership import described
from robot_offload.decide.verdicts import Verdict, no
from robot_offload.kube.port import FIELD_MANAGER, Manifest

FREE: Final = 3
"""How often within `WINDOW_S` a child is corrected without a pause."""
WINDOW_S: Final = 60.0
FIRST_PAUSE_S: Final = 30.0
LONGEST_PAUSE_S: Final = 600.0


@dataclass(frozen=True, slots=True)
class Contest:
    """How often a child was recently taken back.

    Attributes:
        count: corrections in a row, each within `WINDOW_S` after the pause of the one before.
        last_s: the last correction, on the steady clock.
        rival: who had changed the child before it.
    """

    count: int = 0
    last_s: float = float("-inf")
    rival: str = "somebody else"

    @property
    def pause_s(self) -> float:
        """Return the seconds that must pass before the child is taken back again."""
        if self.count < FREE:
            return 0.0
        return min(LONGEST_PAUSE_S, FIRST_PAUSE_S * 2.0 ** (self.count - FREE))

    def waits_s(self, now_s: float) -> float:
        """Return the remaining seconds of the pause; 0: the child may be taken back now."""
        return max(0.0, self.last_s + self.pause_s - now_s)

    def taken_back(self, now_s: float, rival: str) -> Contest:
        """Return the contest after one more correction."""
        calm = now_s - self.last_s > self.pause_s + WINDOW_S
        return Contest(1 if calm else self.count + 1, now_s, rival)


def contested(there: Manifest, contest: Contest) -> Verdict:
    """Return the verdict about a child that another controller keeps changing."""
    other = contest.rival
    return no(
        "Contested",
        f"{described(there)}: {other} sets fields that belong to this RobotOffload again and again; the operator now "
        f"takes them back every {contest.pause_s:.0f} s at most. Stop {other} from writing this object",
    )


def other_manager(there: Manifest) -> str:
    """Return the name of the field manager, other than ours, that wrote the object last."""
    entries: list[Mapping[str, Any]] = [
        entry
        for entry in there["metadata"].get("managedFields") or ()
        if entry.get("manager") != FIELD_MANAGER and not entry.get("subresource")
    ]
    latest = max(entries, key=lambda entry: str(entry.get("time") or ""), default=None)
    return f"field manager {latest['manager']!r}" if latest and latest.get("manager") else "somebody else"
