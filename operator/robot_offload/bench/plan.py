"""How much is measured, and what a group needs to know to run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from robot_offload.bench.results import Priority
from robot_offload.bench.world import Setting


@dataclass(frozen=True)
class Amounts:
    """How much of everything.

    Attributes:
        switches: commanded ones.
        cuts: of 2 s in both directions.
        one_way: cuts of 2 s in each single direction.
        long_cuts: of 10 s in both directions.
        stretches, minutes: of watching for false alarms.
        latency_s, resources_s: length of these observations, seconds.
    """

    switches: int
    cuts: int
    one_way: int
    long_cuts: int
    stretches: int
    minutes: float
    latency_s: float
    resources_s: float


QUICK: Final = Amounts(
    switches=20, cuts=4, one_way=1, long_cuts=1, stretches=1, minutes=0.5, latency_s=15.0, resources_s=15.0
)
"""Both priorities within 8 minutes."""
FULL: Final = Amounts(
    switches=1000, cuts=100, one_way=20, long_cuts=20, stretches=3, minutes=10.0, latency_s=60.0, resources_s=60.0
)
"""The numbers of the table."""


@dataclass(frozen=True)
class Order:
    """What a group is asked to do.

    Attributes:
        amounts: how much.
        priority: of agents and user's nodes.
        out: folder for the runs' files.
        seed: of links and of the moments at which something is done.
        domains: ROS domains of robot and cloud; None picks free ones.
        advance: tells how much of `Group.steps` is done; may be called often.
    """

    amounts: Amounts
    priority: Priority
    out: Path
    seed: int
    domains: tuple[int, int] | None
    advance: Callable[[float], None]

    def setting(self, name: str) -> Setting:
        """For a world whose files go to a folder of that name."""
        folder = self.out / "runs" / f"{name}-{self.priority}"
        return Setting(folder, self.priority == "realtime", self.domains, self.seed)

    def watching(self, name: str) -> Setting:
        """The same with the observer of the lease."""
        return replace(self.setting(name), lease=True)

    def timing(self, name: str) -> Setting:
        """The same with everything that latencies are compared with."""
        return replace(self.setting(name), latency=True)
