"""Whether a side was heard while the other one was in charge: the messages of one output, the announcements. Pure.

What is not counted:

* the old side passes until the first message of the new side (make before break);
* an announcement may lag behind the collector, if only the side that it names is heard until it comes: the cloud's by
  `ANNOUNCEMENT_LAG_S`, the robot's for as long as control stands still, because the collector passes the robot then;
* a preparation whose end is not announced in time: the collector has changed over, and control stood still just then,
  or had just cancelled it. The side that got ready is heard once in between; the other side is heard again when a lease
  ends or the next epoch begins.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

from robot_offload_core.words.decided import Phase
from robot_offload_lab.judge.recording import Arrival, PlacementChange, Site

ANNOUNCEMENT_LAG_S: Final = 0.3
"""How much later than its messages the announcement of the cloud may come: a lease (250 ms by default), because after
a longer silence of control the collector passes the robot only, plus the announcement's way to the recorder."""
_PREPARES: Final = frozenset({Phase.TO_CLOUD, Phase.TO_ROBOT})


@dataclass(frozen=True)
class Interleaving:
    """The messages of the other side that passed in one stay after the stay's own side had begun.

    Attributes:
        stay: the announcement with which the stay began.
        begun: the first message of the stay's side.
        heard: the later messages of the other side.
    """

    stay: PlacementChange
    begun: Arrival
    heard: tuple[Arrival, ...]


@dataclass
class _Preparation:
    """From its announcement to that of its outcome; `site` gets ready and may pass once: `passed`, then `over`."""

    site: Site
    start_s: float
    end_s: float
    passed: bool = False
    over: bool = False

    def excuses(self, arrival: Arrival) -> bool:
        """Take a message of the side that is not in charge; return whether this preparation can explain it."""
        within = self.start_s <= arrival.t_s <= self.end_s + ANNOUNCEMENT_LAG_S
        if self.over or arrival.site != self.site or not within:
            return False
        self.passed = True
        return True


@dataclass
class _Listener:
    """The messages read so far; `begun` and `heard` are keyed by the index of a stay's first announcement."""

    arrivals: Sequence[Arrival]
    placements: Sequence[PlacementChange]
    preparations: list[_Preparation]
    begun: dict[int, Arrival] = field(default_factory=dict)
    heard: dict[int, list[Arrival]] = field(default_factory=dict)

    def hear(self, arrival: Arrival, index: int) -> None:
        """Judge a message; `index` is that of the newest announcement when it passed."""
        stay = _stay(self.placements, index)
        if arrival.site == self.placements[stay].site:
            self.begun.setdefault(stay, arrival)
            for preparation in self.preparations:
                preparation.over |= preparation.passed
            return
        if stay not in self.begun:
            return  # make before break
        announced = self._announced(arrival, index)
        if announced is not None:
            self.begun.setdefault(announced, arrival)
        elif not any(preparation.excuses(arrival) for preparation in self.preparations):
            self.heard.setdefault(stay, []).append(arrival)

    def _announced(self, arrival: Arrival, index: int) -> int | None:
        """Return the index of the next announcement of its side, if in time and only that side is heard until then."""
        following = range(index + 1, len(self.placements))
        announced = next((i for i in following if self.placements[i].site == arrival.site), None)
        if announced is None:
            return None
        until_s = self.placements[announced].t_s
        if arrival.site == "cloud" and until_s > arrival.t_s + ANNOUNCEMENT_LAG_S:
            return None
        alone = all(other.site == arrival.site for other in self.arrivals if arrival.t_s < other.t_s < until_s)
        return announced if alone else None


def interleavings(arrivals: Sequence[Arrival], placements: Sequence[PlacementChange]) -> Iterator[Interleaving]:
    """Yield one for each stay in which the other side was heard after the side in charge had begun.

    Args:
        arrivals: of one output, in the order of time.
        placements: as announced, in the order of time.
    """
    listener = _Listener(arrivals, placements, _preparations(placements))
    index = -1
    for arrival in arrivals:
        while index + 1 < len(placements) and placements[index + 1].t_s <= arrival.t_s:
            index += 1
        if index >= 0:
            listener.hear(arrival, index)
    for stay, heard in listener.heard.items():
        yield Interleaving(placements[stay], listener.begun[stay], tuple(heard))


def _stay(placements: Sequence[PlacementChange], index: int) -> int:
    """Return the announcement with which the present stay began (later ones may only repeat the side)."""
    while index > 0 and placements[index - 1].site == placements[index].site:
        index -= 1
    return index


def _preparations(placements: Sequence[PlacementChange]) -> list[_Preparation]:
    """Return the preparations after which a higher epoch or another control was announced."""
    found = []
    prepared: PlacementChange | None = None
    for before, change in itertools.pairwise(placements):
        if before.phase in _PREPARES and prepared is None:
            prepared = before
        if prepared is None or (change.phase == prepared.phase and change.epoch == prepared.epoch):
            continue
        if change.control != prepared.control or change.epoch > prepared.epoch:
            site: Site = "cloud" if prepared.site == "robot" else "robot"
            found.append(_Preparation(site, prepared.t_s, change.t_s))
        prepared = None
    return found
