"""How much is measured, and what a group needs in order to run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Final, Literal

from robot_offload.errors import InputError
from robot_offload_lab.bench.results import Priority
from robot_offload_lab.bench.world import Setting

Form = Literal["short", "long", "own"]


@dataclass(frozen=True)
class Amounts:
    """How much of everything.

    Attributes:
        form: form of the run. A long one is not replaced by a short one; `own` is neither.
        switches: commanded switches.
        cuts: cuts of 2 s in both directions.
        one_way: cuts of 2 s in each single direction.
        long_cuts: cuts of 10 s in both directions.
        resources_s: length of the observation of processor time and memory, seconds.
        messages: messages of each of the ten publishers, at 10 Hz.
        rounds: rounds of activating and deactivating.
        detections: cuts in each case of detection.
        quiet_s: seconds without a cut before them.
        mirror_cuts: cuts with goals that both sides execute.
        state_cuts: cuts with snapshots of each size.
        hot_switches, hot_cuts: commanded switches and cuts between Hot sides.
        hot_minutes: minutes of watching for false takeovers.
    """

    form: Form
    switches: int
    cuts: int
    one_way: int
    long_cuts: int
    resources_s: float
    messages: int
    rounds: int
    detections: int
    quiet_s: float
    mirror_cuts: int
    state_cuts: int
    hot_switches: int
    hot_cuts: int
    hot_minutes: float


QUICK: Final = Amounts(
    form="short", switches=20, cuts=4, one_way=1, long_cuts=1,
    resources_s=10.0, messages=80, rounds=30, detections=3, quiet_s=15.0,
    mirror_cuts=5, state_cuts=8,
    hot_switches=6, hot_cuts=5, hot_minutes=0.4,
)  # fmt: skip
"""Everything with real-time priority in some 15 minutes."""
FULL: Final = Amounts(
    form="long", switches=1000, cuts=100, one_way=20, long_cuts=20,
    resources_s=60.0, messages=600, rounds=300, detections=30, quiet_s=300.0,
    mirror_cuts=200, state_cuts=200,
    hot_switches=100, hot_cuts=200, hot_minutes=60.0,
)  # fmt: skip
"""The numbers of the table."""


def changed(amounts: Amounts, settings: Sequence[str]) -> Amounts:
    """Return the amounts with other values, each written as NAME=VALUE.

    Raises:
        InputError: a setting names no amount, or its value is not a positive number.
    """
    known = {item.name: type(getattr(amounts, item.name)) for item in fields(amounts) if item.name != "form"}
    for setting in settings:
        name, _, value = setting.partition("=")
        if name not in known:
            raise InputError(f"--set: there is no amount {name!r}; known are {', '.join(known)}")
        try:
            number = known[name](value)
        except ValueError:
            number = 0
        if number <= 0:
            raise InputError(f"--set: {setting!r} is not valid; write for example {name}={getattr(amounts, name)}")
        amounts = replace(amounts, form="own", **{name: number})
    return amounts


@dataclass(frozen=True)
class Order:
    """What a group is asked to do.

    Attributes:
        amounts: how much.
        priority: of agents and user's nodes.
        out: folder for the runs' files.
        seed: of links and of the moments at which something is done.
        domains: ROS domains of robot and cloud; None picks free ones.
        cases: of a group that has several, the ones to run; empty: all.
        against: commit whose agents are measured for comparison; empty: none.
    """

    amounts: Amounts
    priority: Priority
    out: Path
    seed: int
    domains: tuple[int, int] | None
    cases: tuple[str, ...] = ()
    against: str = ""

    def wants(self, case: str) -> bool:
        """Return whether a case is to run."""
        return not self.cases or case in self.cases

    @property
    def realtime(self) -> bool:
        """Whether agents and nodes run under real-time priority."""
        return self.priority == "realtime"

    @property
    def domain(self) -> int | None:
        """The robot's ROS domain; None picks a free one."""
        return self.domains[0] if self.domains else None

    def folder(self, name: str) -> Path:
        """Return the folder for the files of one run."""
        return self.out / "runs" / f"{name}-{self.priority}"

    def setting(self, name: str) -> Setting:
        """Return the setting for a world whose files go to a folder of that name."""
        return Setting(self.folder(name), self.realtime, self.domains, self.seed)

    def watching(self, name: str) -> Setting:
        """Return the same setting with the observer of the lease."""
        return replace(self.setting(name), lease=True)

    def serving(self, name: str) -> Setting:
        """Return the same setting with a client of actions and services."""
        return replace(self.setting(name), goals=True)
