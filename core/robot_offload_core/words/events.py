"""What more than one machine takes in or gives out."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Any, NoReturn, Protocol

from robot_offload_core.fence.lease import Leave
from robot_offload_core.fence.token import Site


def assert_never(unexpected: NoReturn) -> NoReturn:
    """End a `match` over a union: a kind that no case takes in is an error of types, and raise at run time.

    Raises:
        TypeError: something came that is none of the union's types.
    """
    raise TypeError(f"nobody takes in {unexpected!r}")


@dataclass(frozen=True)
class Tick:
    """Time has passed."""


@dataclass(frozen=True)
class Acting:
    """Level, from the machine of a side to its guardian: whether the side's duplicated nodes are to be Active.

    Attributes:
        acting: the side is in charge or gets ready to be.
        outputs_flow: its rated outputs flow.
        in_charge: False while it only gets ready and the other side acts: then nothing of it stops the driver.
        outputs_heard: a message of each was seen in time: flowing counts by grace too (after a pause of the collector,
            after a change of who is in charge), and grace lifts no inhibit.
        silent: names of the outputs that do not flow, as far as the collector said.
        stop: why the driver is to be stopped at once whoever acts; "" for no reason.
    """

    acting: bool
    outputs_flow: bool = True
    in_charge: bool = True
    stop: str = ""
    outputs_heard: bool = True
    silent: tuple[str, ...] = ()


class Machine(str, Enum):
    """The machines of a control process, by the name that a black box gives them."""

    PLACEMENT = "placement"
    LEASE = "lease"
    GUARDIAN = "guardian"


class Witness(Protocol):
    """Sees every step of a control process's machines, as a black box does."""

    def stepped(self, machine: Machine, now_s: float, event: Any, after: Any, commands: Any) -> None:
        """Take a step: event in, state after it and commands out. Must return at once."""

    def restated(self, machine: Machine, now_s: float, state: Any) -> None:
        """Take a state that no step has led to: the first one, or one with settings changed."""

    def broke(self, machine: Machine, now_s: float, event: Any, rule: str) -> None:
        """Take an event whose step broke a rule of the machine: the process ends as soon as this returns."""


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
        site: whose.
        epoch: of the preparation that it is about; 0: none.
        lacking: why the side does not know the state of the one that acts.
        before_active: those of `lacking` that a node takes when it becomes Active, so it is to have them before.
    """

    site: Site
    epoch: int
    lacking: tuple[str, ...] = ()
    before_active: tuple[str, ...] = ()


@dataclass(frozen=True)
class CloudData:
    """The data process's view.

    Attributes:
        age_s: since the robot was last heard on the data session; None never.
        input_ages_s: newest accepted age of each required input; None never.
        rated: bits of the outputs whose `while` is true here, see beats.CloudReport.
    """

    age_s: float | None
    input_ages_s: tuple[float | None, ...]
    rated: int = 0


@dataclass(frozen=True)
class SetEgress(Leave):
    """To the data process: what may leave, until when."""
