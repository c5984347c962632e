"""A decision about the placement."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from robot_offload_core.fence.token import Site
from robot_offload_core.words.reasons import Verdict


@dataclass(frozen=True)
class Decided:
    """A decision about the placement, for the log, the diagnostics and /offload/placement.

    Attributes:
        site, epoch: the side in charge now and its epoch.
        phase: see Phase.
        verdict: reason and message of the change.
        switched: the side in charge changed.
        silent_s: time since the last good beat, at a sudden loss; None for a commanded change.
    """

    site: Site
    epoch: int
    phase: Phase
    verdict: Verdict
    switched: bool
    silent_s: float | None = None


class Phase(str, Enum):
    """Which side acts, and which change is under way.

    ROBOT: the robot acts. TO_CLOUD: the robot acts while the cloud gets ready under a candidate epoch. CLOUD: the cloud
    acts. TO_ROBOT: the cloud acts while the robot's nodes activate. TAKEOVER: the robot is in charge after a sudden
    loss, and its CORE nodes still activate.
    """

    ROBOT = "Robot"
    TO_CLOUD = "ToCloud"
    CLOUD = "Cloud"
    TO_ROBOT = "ToRobot"
    TAKEOVER = "Takeover"
