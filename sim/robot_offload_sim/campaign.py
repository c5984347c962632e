"""Many stretches of simulated time, on several processes, added up."""

from __future__ import annotations

import gc
import math
import multiprocessing
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial

from robot_offload_sim.chunk import CHUNK_S, Chunk, Outcome
from robot_offload_sim.mutants.mutant_list import MUTANTS
from robot_offload_sim.mutants.mutants import planted
from robot_offload_sim.stories import goal_storm
from robot_offload_sim.world import coverage
from robot_offload_sim.world.coverage import Pair


@dataclass(frozen=True)
class Broken:
    """A violation: its stretch, its text, and the last events before it."""

    index: int
    text: str
    story: tuple[str, ...]


@dataclass
class Total:
    """The totals of a campaign; `unreplayed`: stretches without a violation whose black boxes held no step."""

    simulated_s: float = 0.0
    faults: int = 0
    events: int = 0
    commanded: int = 0
    sudden: int = 0
    goals_s: float = 0.0
    state_s: float = 0.0
    worlds: dict[str, int] = field(default_factory=dict)
    pairs: dict[Pair, int] = field(default_factory=dict)
    replayed: int = 0
    unreplayed: list[int] = field(default_factory=list)
    broken: list[Broken] = field(default_factory=list)

    def add(self, index: int, outcome: Outcome) -> None:
        """Add one stretch."""
        self.simulated_s += outcome.simulated_s
        self.faults += outcome.faults
        self.events += outcome.events
        self.commanded += outcome.commanded
        self.sudden += outcome.sudden
        self.goals_s += outcome.goals_s
        self.state_s += outcome.state_s
        for name in outcome.worlds:
            self.worlds[name] = self.worlds.get(name, 0) + 1
        for pair, count in outcome.pairs.items():
            self.pairs[pair] = self.pairs.get(pair, 0) + count
        self.replayed += outcome.replayed
        if outcome.violation:
            self.broken.append(Broken(index, outcome.violation, outcome.story))
        elif not outcome.replayed:
            self.unreplayed.append(index)

    @property
    def missing(self) -> list[Pair]:
        """Return the pairs of state and event that can occur but did not."""
        return sorted(coverage.expected() - self.pairs.keys())

    @property
    def covered_share(self) -> float:
        """Return the share of the possible pairs that occurred."""
        expected = coverage.expected()
        return len(expected & self.pairs.keys()) / len(expected)


def chunks_for(hours: float) -> int:
    """Return how many stretches make up `hours` of simulated time."""
    return max(1, math.ceil(hours * 3600 / CHUNK_S))


def live(seed: int, mutant: str | None, goals: bool, index: int) -> tuple[int, Outcome]:
    """Run one stretch, with goals and calls in some or all; seed and index reproduce it on any machine."""
    with planted(MUTANTS[mutant] if mutant else None):
        if goals or goal_storm.with_goals(index):
            outcome = goal_storm.live(seed, index, state=goals)
        else:
            outcome = Chunk(seed, index).live()
    gc.collect()  # a world is one big cycle; it is collected once, at its end
    return index, outcome


def run(
    seed: int, indices: range, workers: int, mutant: str | None = None, *, goals: bool = False
) -> Iterator[tuple[int, Outcome]]:
    """Run the stretches and yield each as it is done, in any order; `goals`: all of them with goals and calls."""
    task = partial(live, seed, mutant, goals)
    if workers <= 1:
        gc.disable()
        try:
            yield from map(task, indices)
        finally:
            gc.enable()
        return
    with multiprocessing.get_context("spawn").Pool(workers, initializer=gc.disable) as pool:
        yield from pool.imap_unordered(task, indices)
