"""What the bench's observers write down, a JSON object a line, and how it is read back. Pure but for `read`.

All times are seconds of this host's steady clock (CLOCK_BOOTTIME), which the agents use too.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeAlias, TypeVar


@dataclass(frozen=True)
class Placed:
    """An announcement on /offload/placement.

    Attributes:
        t_s: when it was heard.
        site: the side in charge, since since_s (told by the robot's control process).
        phase: of the placement machine, e.g. `ToRobot`.
        silent_ms: from the last good beat to the decision; None when the change was commanded.
    """

    t_s: float
    site: str
    phase: str
    epoch: int
    reason: str
    since_s: float
    silent_ms: float | None


@dataclass(frozen=True)
class Transition:
    """A lifecycle node told that it has reached a state (its transition event was heard)."""

    t_s: float
    state: str


@dataclass(frozen=True)
class Answered:
    """A switch by hand was asked for at asked_s and answered at t_s."""

    t_s: float
    asked_s: float
    site: str
    accepted: bool
    message: str


@dataclass(frozen=True)
class BeatHeard:
    """A beat of the other side that reached the agent of this side, as it mirrors them."""

    t_s: float
    text: str


@dataclass(frozen=True)
class Departed:
    """An envelope left the cloud agent. `header` in hexadecimal digits."""

    t_s: float
    output: str
    header: str


@dataclass(frozen=True)
class Reached:
    """A beat of the robot reached the cloud agent's listener."""

    t_s: float
    text: str


@dataclass(frozen=True)
class Hop:
    """As many datagrams as a message of `size` bytes needs went down the emulated link in `delay_ms`."""

    t_s: float
    size: int
    delay_ms: float


Observation: TypeAlias = Placed | Transition | Answered | BeatHeard | Departed | Reached | Hop
_KINDS: Final = {
    kind.__name__.lower(): kind for kind in (Placed, Transition, Answered, BeatHeard, Departed, Reached, Hop)
}
Kind = TypeVar("Kind", bound=Observation)


def encode(observation: Observation) -> str:
    """One line, without its end."""
    values = dataclasses.asdict(observation)
    return json.dumps({"kind": type(observation).__name__.lower(), **values}, separators=(",", ":"))


def decode(line: str) -> Observation:
    """The observation of a line.

    Raises:
        ValueError: it is none.
    """
    try:
        values = json.loads(line)
        found: Observation = _KINDS[values.pop("kind")](**values)
    except (TypeError, KeyError, AttributeError) as error:
        raise ValueError(f"no observation: {line[:80]!r}") from error
    return found


def parse(lines: Iterable[str]) -> Iterator[Observation]:
    """Every whole line; an unfinished last one (the observer was ended) is left out."""
    for line in lines:
        if line.endswith("\n"):
            yield decode(line)


def read(path: Path) -> tuple[Observation, ...]:
    """What an observer has written; nothing when it never came to write."""
    if not path.exists():
        return ()
    with path.open(encoding="utf-8") as lines:
        return tuple(parse(lines))


def only(kind: type[Kind], observations: Iterable[Observation]) -> tuple[Kind, ...]:
    """Those of one kind, in the order of time."""
    return tuple(sorted((o for o in observations if isinstance(o, kind)), key=lambda o: o.t_s))


def placed(t_s: float, text: str) -> Placed | None:
    """The announcement as published; None when it cannot be read."""
    try:
        said: dict[str, Any] = json.loads(text)
        silent_ms = said["silent_ms"]
        return Placed(
            t_s, str(said["site"]), str(said["phase"]), int(said["epoch"]), str(said["reason"]),
            float(said["since_s"]), None if silent_ms is None else float(silent_ms),
        )  # fmt: skip
    except (ValueError, KeyError, TypeError):
        return None


def size_of(sequence: int, sizes: Sequence[int]) -> int:
    """The payload of the message with this number: the sizes take turns."""
    return sizes[sequence % len(sizes)]
