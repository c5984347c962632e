"""What must hold for every message that reached the consumer of a collected output, whatever happened to the agents."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

NEAR_S = 2.0
"""An announcement belongs to a change of the passing side so close to it; a restarted control needs a second."""


class ViolationError(AssertionError):
    """A rule of the switch was broken: never given a second chance, however busy the machine was."""


@dataclass(frozen=True)
class Arrival:
    """One message at the consumer; its time on the steady clock, its age when the collector let it pass, in seconds."""

    t_s: float
    producer: str
    sequence: int
    age_s: float

    @property
    def site(self) -> str:
        """The cloud's replicas are called remote_NAME."""
        return "cloud" if self.producer.startswith("remote_") else "robot"


@dataclass(frozen=True)
class Placed:
    """One /offload/placement."""

    t_s: float
    site: str
    epoch: int
    phase: str
    reason: str
    message: str


def violations(
    arrivals: Sequence[Arrival], placed: Sequence[Placed], max_age_s: float, begun_s: Sequence[float] = ()
) -> list[str]:
    """Sentences about what went wrong at the consumer; empty when all held.

    `max_age_s` is the limit for the cloud's messages, with what the measuring itself may add; `begun_s` are the
    moments at which the robot's control was started anew.
    """
    found = []
    newest: dict[str, int] = {}
    for arrival in arrivals:
        known = newest.get(arrival.producer, 0)
        if arrival.sequence == known:
            found.append(f"{arrival} came twice")
        elif arrival.sequence < known:
            found.append(f"{arrival} came after number {known}")
        newest[arrival.producer] = max(known, arrival.sequence)
        if arrival.site == "cloud" and arrival.age_s > max_age_s:
            found.append(f"{arrival} is older than {max_age_s} s")
    return found + _interleaved(arrivals, _changes(placed, begun_s))


def _changes(placed: Sequence[Placed], begun_s: Sequence[float]) -> list[Placed]:
    """The announced changes of the side in charge.

    A new control begins with the robot in charge and says so before anybody has discovered it, so its first heard
    word may be that the cloud is: then it has changed over twice.
    """
    changes = []
    for before, p in itertools.pairwise(placed):
        anew = any(before.t_s < moment <= p.t_s for moment in begun_s)
        if anew and p.site == "cloud":
            changes += [replace(p, site="robot"), p]
        elif p.site != before.site:
            changes.append(p)
    return changes


def _interleaved(arrivals: Sequence[Arrival], changes: list[Placed]) -> list[str]:
    """Each change of the passing side has an announcement of its own near it; else both sides were heard mixed."""
    found = []
    for before, arrival in itertools.pairwise(arrivals):
        if arrival.site == before.site:
            continue
        own = next((p for p in changes if p.site == arrival.site and abs(p.t_s - arrival.t_s) < NEAR_S), None)
        if own is None:
            found.append(f"{arrival} follows {before} although no switch was announced")
        else:
            changes.remove(own)
    return found


def holes(arrivals: Sequence[Arrival]) -> int:
    """Messages missing between the first and the last passed one of each stay of a producer."""
    return sum(
        after.sequence - before.sequence - 1
        for before, after in itertools.pairwise(arrivals)
        if after.producer == before.producer
    )


def longest_gap_s(arrivals: Sequence[Arrival], from_s: float, to_s: float) -> float:
    """The longest silence at the consumer between two moments."""
    times = [from_s, *(a.t_s for a in arrivals if from_s < a.t_s < to_s), to_s]
    return max(after - before for before, after in itertools.pairwise(times))
