"""Events and commands that several machines share."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Any, NoReturn, Protocol

from robot_offload_core.fence.lease import Leave
from robot_offload_core.fence.token import Site


def assert_never(unexpected: NoReturn) -> NoReturn:
    """End a `match` over a union: a missing case is an error for the type checker, and raises at run time.

    Raises:
        TypeError: the value has none of the union's types.
    """
    raise TypeError(f"nobody takes in {unexpected!r}")


@dataclass(frozen=True)
class Tick:
    """Time has passed."""


@dataclass(frozen=True)
class Acting:
    """Level from the machine of a side to its guardian: whether the side's duplicated nodes are to be Active.

    Attributes:
        acting: the side is in charge or gets ready to be.
        outputs_flow: its rated outputs flow.
        in_charge: False while the side only gets ready and the other one acts; then it cannot stop the driver.
        outputs_heard: a message of each rated output was seen in time. `outputs_flow` may also be true by grace (after
            a pause of the collector, after a change of the side in charge), and grace lifts no inhibit.
        silent: names of the outputs that do not flow, as far as the collector has reported them.
        stop: why the driver is to be stopped at once, whichever side acts; "" for no reason.
    """

    acting: bool
    outputs_flow: bool = True
    in_charge: bool = True
    stop: str = ""
    outputs_heard: bool = True
    silent: tuple[str, ...] = ()


class Machine(str, Enum):
    """The machines of a control process, by their names in a black box."""

    PLACEMENT = "placement"
    LEASE = "lease"
    GUARDIAN = "guardian"


class Witness(Protocol):
    """Sees every step of a control process's machines, as a black box does."""

    def stepped(self, machine: Machine, now_s: float, event: Any, after: Any, commands: Any) -> None:
        """Take a step: its event, the state after it and its commands. Must return at once."""

    def restated(self, machine: Machine, now_s: float, state: Any) -> None:
        """Take a state that is not the result of a step: the first one, or one with changed settings."""

    def broke(self, machine: Machine, now_s: float, event: Any, rule: str) -> None:
        """Take an event whose step broke a rule of the machine; the process ends as soon as this returns."""


@dataclass(frozen=True)
class DataReported:
    """The data process reported: session, age of the newest probe, incarnation of the cloud's control seen there."""

    connected: bool
    age_s: float | None
    cloud: str


@dataclass(frozen=True)
class StateReported:
    """A data process reported which state its side lacks.

    Attributes:
        site: the side that lacks it.
        epoch: of the preparation that the report is about; 0: none.
        lacking: why the side does not know the state of the acting side.
        before_active: those of `lacking` that a node needs before it becomes Active.
    """

    site: Site
    epoch: int
    lacking: tuple[str, ...] = ()
    before_active: tuple[str, ...] = ()


@dataclass(frozen=True)
class CloudData:
    """What the cloud's data process reports to its machine.

    Attributes:
        age_s: time since the robot was last heard on the data session; None never.
        input_ages_s: newest accepted age of each required input; None never.
        rated: bits of the outputs whose `while` is true here, see beats.CloudReport.
    """

    age_s: float | None
    input_ages_s: tuple[float | None, ...]
    rated: int = 0


@dataclass(frozen=True)
class SetEgress(Leave):
    """To the data process: what may leave, until when."""
