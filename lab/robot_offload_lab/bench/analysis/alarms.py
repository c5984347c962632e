"""False alarms: on a link that is good enough all the time, how often the robot takes over as if it were lost."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

from robot_offload_lab.bench.observed import Observation, only
from robot_offload_lab.judge.recording import PlacementChange


@dataclass(frozen=True)
class QuietStretch:
    """One stretch of observation, from start_s to end_s, by the witness on the robot."""

    start_s: float
    end_s: float
    robot: tuple[Observation, ...]

    @property
    def length_s(self) -> float:
        """How long it took."""
        return self.end_s - self.start_s


@dataclass(frozen=True)
class Leave:
    """The cloud was left, after a sudden loss (a false alarm) or by a decision of the latency rule."""

    t_s: float
    reason: str
    sudden: bool


def leaves(watch: QuietStretch) -> tuple[Leave, ...]:
    """Return every time that the side in charge changed from cloud to robot."""
    placements = only(PlacementChange, watch.robot)
    return tuple(
        Leave(change.decided_s - watch.start_s, change.reason, change.detect_ms is not None)
        for before, change in itertools.pairwise(placements)
        if before.site == "cloud" and change.site == "robot" and watch.start_s <= change.decided_s <= watch.end_s
    )
