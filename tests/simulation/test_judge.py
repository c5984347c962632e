"""The judge of recordings, `lab/judge/interleaving`, in storms: what a consumer hears of sound agents is never blamed.

The observer knows the state of every process. A recording has the messages and the announcements alone, and those are
late when a process stands still; so the judge has to know every sequence in which a sound system may be heard.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from robot_offload_core.words.decided import Decided
from robot_offload_lab.judge.interleaving import Interleaving, interleavings
from robot_offload_lab.judge.recording import Arrival, PlacementChange
from robot_offload_sim.chunk import Chunk, Outcome
from robot_offload_sim.mutants.mutant_list import MUTANTS
from robot_offload_sim.mutants.mutants import planted
from robot_offload_sim.promises.observer import Observer
from robot_offload_sim.world.ports import Payload

pytestmark = [pytest.mark.simulation]
SEED = 77
STRETCHES = (6, 7, 10, 12, 15, 25, 58)
"""Each with a sequence that was blamed once: a stay shorter than an announcement's delay, a preparation called off
after the collector had changed over, control that stood still at the changeover or after it."""


class Recorder:
    """Writes down what a recording of a stretch would have, and hands everything on to the observer."""

    def __init__(self, observer: Observer) -> None:
        self.observer = observer
        self.control = ""
        self.arrivals: dict[int, list[Arrival]] = {}
        self.placements: list[PlacementChange] = []

    def __getattr__(self, name: str) -> Callable[..., Any]:
        """Returns the observer's method for whatever is not written down."""
        told: Callable[..., Any] = getattr(self.observer, name)
        return told

    def robot_started(self, incarnation: str) -> None:
        self.control = incarnation
        self.observer.robot_started(incarnation)

    def robot_decided(self, decided: Decided) -> None:
        self.placements.append(
            PlacementChange(
                self.observer.world.now,
                decided.site.value,
                decided.epoch,
                decided.verdict.reason.value,
                phase=decided.phase.value,
                control=self.control,
            )
        )
        self.observer.robot_decided(decided)

    def passed(self, index: int, payload: Payload) -> None:
        if not self.observer.run.scenario.outputs[index].of_cloud:
            now, message = self.observer.world.now, payload.message
            self.arrivals.setdefault(index, []).append(
                Arrival(str(index), now, message.producer, message.sequence, now, payload.site.value)
            )
        self.observer.passed(index, payload)

    def blamed(self) -> Iterator[Interleaving]:
        """What the judge finds, in all outputs."""
        for arrivals in self.arrivals.values():
            yield from interleavings(arrivals, self.placements)


def live(index: int) -> tuple[Outcome, Recorder]:
    """A stretch, and what would have been recorded of it."""
    chunk = Chunk(SEED, index)
    recorder = Recorder(chunk.observer)
    chunk.system.around.witness = recorder
    return chunk.live(), recorder


@pytest.mark.parametrize("index", STRETCHES)
def test_nothing_that_sound_agents_do_in_a_storm_is_interleaved(index: int) -> None:
    outcome, recorder = live(index)
    assert outcome.violation == ""
    assert outcome.commanded + outcome.sudden > 0
    assert min(len(recorder.placements), len(recorder.arrivals)) > 0
    assert [*recorder.blamed()] == []


def test_a_hot_robot_that_passes_while_the_cloud_acts_is_interleaved() -> None:
    with planted(MUTANTS["C10"]):
        blamed = [found for index in STRETCHES for found in live(index)[1].blamed()]
    assert "cloud" in {found.stay.site for found in blamed}
