"""What must hold for every message that reached the consumer of a collected output, whatever happened to the agents."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

from robot_offload_lab.judge.recording import Arrival, PlacementChange
from robot_offload_lab.judge.streams import examine

NEAR_S = 2.0
"""An announcement belongs to a change of the passing side so close to it; a stopped control needs a second."""
UNDISTURBED_S = 1.0
"""The silence around something that disturbs nobody is shorter, on a busy machine too."""
CALLED_OFF_S = 0.5
"""The collector has heard by then that a preparation was called off."""


class ViolationError(AssertionError):
    """A rule of the switch was broken: never given a second chance, however busy the machine was."""


@dataclass(frozen=True)
class Change:
    """The side in charge became `site` at some moment from `from_s` to `to_s`; `near_s` is added on both ends."""

    site: str
    from_s: float
    to_s: float
    near_s: float = NEAR_S

    def explains(self, arrival: Arrival) -> bool:
        """Whether a message of that side may be the first one after it."""
        return self.site == arrival.site and self.from_s - self.near_s < arrival.t_s < self.to_s + self.near_s


def violations(
    arrivals: Sequence[Arrival], placed: Sequence[PlacementChange], max_age_s: float, begun_s: Sequence[float] = ()
) -> list[str]:
    """Sentences about what went wrong at the consumer; empty when all held.

    `max_age_s` is the limit for the cloud's messages, with what the measuring itself may add; `begun_s` are the
    moments at which the robot's control was started anew.
    """
    stream = examine("", arrivals, float("inf"), max_age_s * 1e3)
    found = [f"{arrival} came twice" for arrival in stream.duplicates]
    found += [f"{arrival} came after a later one" for arrival in stream.reordered]
    found += [f"{arrival} is older than {max_age_s} s" for arrival in stream.stale if arrival.site == "cloud"]
    return found + _interleaved(arrivals, _changes(placed, begun_s))


def _changes(placed: Sequence[PlacementChange], begun_s: Sequence[float]) -> list[Change]:
    """The changes of the side in charge.

    A new control begins with the robot in charge and says so before anybody has discovered it: the first of its words
    that is heard may be that the cloud is, seconds later. So each new control has put the robot in charge at some
    moment between the latest start before its first word that was heard, and that word.

    The collector may change over to a cloud that is ready just before it hears that this was called off. Control never
    comes to believe that the cloud is in charge then, so nobody says so, and the robot passes again under a new epoch.
    """
    changes = []
    site, control, prepared_s = "", None, None
    for p in placed:
        if prepared_s is not None and p.site == "robot" and p.control == control:
            changes += [Change(to, prepared_s, p.t_s, CALLED_OFF_S) for to in ("cloud", "robot")]
        prepared_s = p.t_s if p.phase == "ToCloud" else None
        if p.control != control:
            began_s = max((moment for moment in begun_s if moment <= p.t_s), default=p.t_s)
            if site != "robot":
                changes.append(Change("robot", began_s, p.t_s))
            site, control = "robot", p.control
        if p.site != site:
            changes.append(Change(p.site, p.t_s, p.t_s))
            site = p.site
    return changes


def _interleaved(arrivals: Sequence[Arrival], changes: list[Change]) -> list[str]:
    """Each change of the passing side has an announcement of its own near it; else both sides were heard mixed."""
    found = []
    for before, arrival in itertools.pairwise(arrivals):
        if arrival.site == before.site:
            continue
        own = next((change for change in changes if change.explains(arrival)), None)
        if own is None:
            found.append(f"{arrival} follows {before} although no switch was announced")
        else:
            changes.remove(own)
    return found


def holes(arrivals: Sequence[Arrival]) -> int:
    """Messages missing between the first and the last passed one of each stay of a producer."""
    return examine("", arrivals, float("inf"), float("inf")).lost


def longest_gap_s(arrivals: Sequence[Arrival], from_s: float) -> float:
    """The longest silence at the consumer from a moment on that the switch is to blame for.

    A producer may have been silent itself (it is an ordinary process on a busy machine): between two messages that
    follow each other at their producer, only how long the later one was under way counts. A lost message, and any
    change of the producer, count in full.
    """
    heard = [a for a in arrivals if a.t_s > from_s]
    gaps = [heard[0].t_s - from_s] if heard else [float("inf")]
    for before, after in itertools.pairwise(heard):
        follows = after.producer == before.producer and after.sequence == before.sequence + 1
        gaps.append(min(after.t_s - before.t_s, after.age_s) if follows else after.t_s - before.t_s)
    return max(gaps)
