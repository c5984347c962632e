"""Definition of a fault: its time, kind, duration, and how it is undone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

from robot_offload_sim.sides.keeping import Kept
from robot_offload_sim.sides.system import System
from robot_offload_sim.world.link_model import Wire
from robot_offload_sim.world.nodes import Node

Undo = Callable[[], None]
T = TypeVar("T")


@dataclass(frozen=True)
class Fault:
    """One planned fault.

    Attributes:
        at_s: true time of its start.
        kind: a key of KINDS.
        duration_s: how long it lasts.
        pick: random number, 0 to 1, for choices that the kind leaves open (which process, which direction).
    """

    at_s: float
    kind: str
    duration_s: float
    pick: float


@dataclass(frozen=True)
class Kind:
    """A kind of fault: how often, how long (seconds), its effect, and what it leaves behind after its end."""

    weight: float
    lasts_s: tuple[float, float]
    apply: Callable[[System, Fault], Undo]
    tail_s: float = 0.0


def option(options: list[T] | tuple[T, ...], pick: float) -> tuple[T, float]:
    """Return the option that `pick` selects, and the rest of the random number."""
    scaled = pick * len(options)
    return options[int(scaled)], scaled - int(scaled)


def raised(things: Sequence[Wire] | Sequence[Node] | Sequence[Kept], attribute: str, by: float) -> Undo:
    """Raise an amount of several things; faults of one kind may overlap, so undoing subtracts only its own."""

    def add(value: float) -> None:
        for thing in things:
            setattr(thing, attribute, max(0, getattr(thing, attribute) + value))

    add(by)
    return lambda: add(-by)


def nothing() -> None:
    """Do nothing, for faults that end by themselves."""
