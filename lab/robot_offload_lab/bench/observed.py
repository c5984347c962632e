"""What the bench's observers record, one JSON object per line, and how it is read back. Pure except for `read`.

All times are seconds of this host's steady clock (CLOCK_BOOTTIME), which the agents use too.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeAlias, TypeVar

from robot_offload_lab.judge.lines import Lines, Record
from robot_offload_lab.judge.recording import PlacementChange


@dataclass(frozen=True)
class Transition(Record):
    """A lifecycle node reported that it has reached a state (its transition event was heard)."""

    t_s: float
    state: str


@dataclass(frozen=True)
class Answered(Record):
    """A switch by hand was asked for at asked_s and answered at t_s."""

    t_s: float
    asked_s: float
    site: str
    accepted: bool
    message: str


@dataclass(frozen=True)
class BeatHeard(Record):
    """A beat of the other side that reached the agent of this side, as it mirrors them."""

    t_s: float
    text: str


@dataclass(frozen=True)
class Departed(Record):
    """An envelope left the cloud agent. `header` in hexadecimal digits."""

    t_s: float
    output: str
    header: str


@dataclass(frozen=True)
class Reached(Record):
    """A beat of the robot reached the cloud agent's listener."""

    t_s: float
    text: str


@dataclass(frozen=True)
class Hop(Record):
    """As many datagrams as a message of `size` bytes needs went down the emulated link in `delay_ms`."""

    t_s: float
    size: int
    delay_ms: float


@dataclass(frozen=True)
class GoalAnswered(Record):
    """A goal of `order` ticks was sent at asked_s by the path `prefix` and answered at t_s."""

    t_s: float
    asked_s: float
    goal: int
    prefix: str
    order: int
    accepted: bool


@dataclass(frozen=True)
class GoalFeedback(Record):
    """Feedback of a goal: the `tick` of the executing `process`."""

    t_s: float
    goal: int
    process: int
    tick: int


@dataclass(frozen=True)
class GoalEnded(Record):
    """The result of a goal reached its client. `status` as in action_msgs; `process` finished it, 0: unknown."""

    t_s: float
    goal: int
    prefix: str
    status: int
    process: int


@dataclass(frozen=True)
class CallAnswered(Record):
    """A service called at asked_s by the path `prefix` answered at t_s."""

    t_s: float
    asked_s: float
    prefix: str
    success: bool


@dataclass(frozen=True)
class Woken(Record):
    """A node with state is being activated."""

    t_s: float


@dataclass(frozen=True)
class SnapshotTaken(Record):
    """A node with state took a snapshot of `size` bytes that its replica had made at made_s."""

    t_s: float
    made_s: float
    size: int


@dataclass(frozen=True)
class FirstOutput(Record):
    """A node with state published for the first time since it woke."""

    t_s: float


Observation: TypeAlias = (
    PlacementChange | Transition | Answered | BeatHeard | Departed | Reached | Hop | GoalAnswered | GoalFeedback
    | GoalEnded | CallAnswered | Woken | SnapshotTaken | FirstOutput
)  # fmt: skip
_KINDS: Final[tuple[type[Record], ...]] = (
    PlacementChange, Transition, Answered, BeatHeard, Departed, Reached, Hop, GoalAnswered, GoalFeedback, GoalEnded,
    CallAnswered, Woken, SnapshotTaken, FirstOutput,
)  # fmt: skip
LINES: Final = Lines[Any]({kind.__name__.lower(): kind for kind in _KINDS})
"""How observations are written and read."""
Kind = TypeVar("Kind", bound=Observation)


def parse(lines: Iterable[str]) -> Iterator[Observation]:
    """Yield every whole line; an unfinished last one (the observer was ended) is left out."""
    for line in lines:
        if line.endswith("\n"):
            yield LINES.decode(line)


def read(path: Path) -> tuple[Observation, ...]:
    """Return what an observer has written; nothing if it has not written at all."""
    if not path.exists():
        return ()
    with path.open(encoding="utf-8") as lines:
        return tuple(parse(lines))


def only(kind: type[Kind], observations: Iterable[Observation]) -> tuple[Kind, ...]:
    """Return the observations of one kind, in the order of time."""
    return tuple(sorted((o for o in observations if isinstance(o, kind)), key=lambda o: o.t_s))


def size_of(sequence: int, sizes: Sequence[int]) -> int:
    """Return the payload size of the message with this number: the sizes take turns."""
    return sizes[sequence % len(sizes)]
