"""One stretch of simulated time: a world from one seed, run to its end or to the first violation."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass, field

from robot_offload_core.fence.token import Site
from robot_offload_core.words.checks import InvariantError
from robot_offload_sim.faults import worlds
from robot_offload_sim.faults.faults import Faults, Hands, only_link, plan, plan_ambushes
from robot_offload_sim.promises.observer import Observer
from robot_offload_sim.sides.system import System
from robot_offload_sim.world import boxes
from robot_offload_sim.world import scenario as scenarios
from robot_offload_sim.world.boxes import Boxes
from robot_offload_sim.world.coverage import Pair
from robot_offload_sim.world.scenario import Scenario
from robot_offload_sim.world.violations import ViolationError

CHUNK_S = 60.0
STORY_LENGTH = 40
BOXED = 17
"""Every 17th stretch is kept in its black boxes as a whole, the others in part: writing and replaying a whole one takes
half as long again as running it. 17 has no divisor in common with the stretches in which only the link fails (5) or
goals run (6), so all kinds get some."""
BOXED_SHARE = 0.2


def boxed_s(seed: int, index: int) -> tuple[float, float]:
    """Return start and end of the part of a stretch that is kept in black boxes, seconds of true time."""
    if index % BOXED == BOXED - 1:
        return boxes.WHOLE
    begins_s = random.Random(f"{seed}/{index}/boxes").uniform(0.0, (1.0 - BOXED_SHARE) * CHUNK_S)
    return begins_s, begins_s + BOXED_SHARE * CHUNK_S


@dataclass
class Outcome:
    """The outcome of one stretch; `add` adds up figures.

    Attributes:
        simulated_s, faults, events: how much was simulated.
        commanded, sudden: changeovers.
        passed_robot, passed_cloud: messages passed.
        worlds: worlds of the stretch.
        goals_s: seconds of it with goals and calls.
        state_s: seconds of it with state.
        replayed: steps in the replay of the black boxes, each with the recorded decisions.
        pairs: coverage.
        violation: the text of the first violation, with the story that led to it.
    """

    simulated_s: float = 0.0
    faults: int = 0
    events: int = 0
    commanded: int = 0
    sudden: int = 0
    passed_robot: int = 0
    passed_cloud: int = 0
    replayed: int = 0
    pairs: dict[Pair, int] = field(default_factory=dict)
    alarms: dict[str, int] = field(default_factory=dict)
    worlds: tuple[str, ...] = ()
    goals_s: float = 0.0
    state_s: float = 0.0
    violation: str = ""
    story: tuple[str, ...] = ()


class Chunk:
    """A system in its storms, with its observer."""

    def __init__(self, seed: int, index: int, draw: Callable[[random.Random], Scenario] = scenarios.draw) -> None:
        name = f"{seed}/{index}"
        dice, others = random.Random(name + "/plan"), random.Random(name + "/world")
        names = worlds.draw(others, only_link=only_link(index))
        self.system = System(worlds.made(draw(dice), names, others), name)
        worlds.happen(self.system, others)
        self.faults = Faults(self.system, plan(dice, index), plan_ambushes(dice, index))
        self.hands = Hands(self.system, dice)
        self.observer = Observer(self.system, self.faults.quiet_s, only_link=only_link(index))
        self.system.around.witness = self.observer
        self.system.around.entered = self.faults.entered
        world = self.system.world
        self.boxes = Boxes(lambda: world.now, boxed_s(seed, index))
        self.system.around.controlled = self.boxes.watch

    def live(self) -> Outcome:
        """Run to the end or to the first violation."""
        violation, replayed = "", 0
        story: tuple[str, ...] = ()
        system, observer = self.system, self.observer
        try:
            system.start()
            system.world.run(CHUNK_S)
            replayed = self.boxes.judge(system.world.now)
        except ViolationError as broken:
            violation = f"{broken.invariant}: {broken.text} (at {broken.at_s:.4f} s)"
            story = system.world.story(STORY_LENGTH)
        except InvariantError as broken:
            violation = f"check: {broken} (at {system.world.now:.4f} s)"
            story = system.world.story(STORY_LENGTH)
        return Outcome(
            simulated_s=system.world.now,
            faults=sum(self.faults.injected.values()),
            events=system.world.events,
            commanded=observer.changeovers["commanded"],
            sudden=observer.changeovers["sudden"],
            passed_robot=observer.passed_messages[Site.ROBOT],
            passed_cloud=observer.passed_messages[Site.CLOUD],
            replayed=replayed,
            pairs=system.coverage.pairs,
            alarms=observer.alarms,
            worlds=system.scenario.worlds,
            violation=violation,
            story=story,
        )
