"""What a user would choose instead of the agents to notice a lost link: names and figures. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class Rival:
    """One way to notice a lost link.

    Attributes:
        name: a word; also its topic.
        title: for people.
        period_s: between two messages; None: the product's heartbeat period of the run.
        patience_s: of silence; None: the product's loss timeout of the run.
    """

    name: str
    title: str
    period_s: float | None
    patience_s: float | None


LIVELINESS: Final = Rival("liveliness", "DDS liveliness, 220 ms lease", 0.200, 0.220)
"""As in the software watchdogs for ROS 2: the middleware reports that a publisher has not asserted its liveliness."""
BOND: Final = Rival("bond", "bond as in Nav2, 4 s", 0.250, 4.0)
MESSAGE: Final = Rival("message", "one message, one threshold (thesis)", None, None)
RIVALS: Final = (LIVELINESS, BOND, MESSAGE)


@dataclass(frozen=True)
class RivalReport:
    """A rival reported that the other side is lost, or that it is back, at t_s of the steady clock."""

    t_s: float
    rival: str
    lost: bool
