"""One stretch of simulated time: a world from one seed, lived to its end or to the first violation."""

from __future__ import annotations

import random
from dataclasses import dataclass, field

from robot_offload_lab.simulate import faults as faults_module
from robot_offload_lab.simulate import scenario as scenarios
from robot_offload_lab.simulate.cloud_side import CloudSide
from robot_offload_lab.simulate.coverage import Coverage, Pair
from robot_offload_lab.simulate.driver import Driver
from robot_offload_lab.simulate.faults import Faults, Hands
from robot_offload_lab.simulate.link_model import Link
from robot_offload_lab.simulate.observer import Observer, ViolationError
from robot_offload_lab.simulate.robot_side import RobotSide
from robot_offload_lab.simulate.world import Host, World

CHUNK_S = 60.0
STORY_LENGTH = 40


@dataclass
class Outcome:
    """What one stretch has come to; figures add up with `add`.

    Attributes:
        simulated_s, faults, events: how much was lived through.
        commanded, sudden: changeovers. passed_robot, passed_cloud: messages passed.
        pairs: coverage. violation: the text of the first violation, with the story that led to it.
    """

    simulated_s: float = 0.0
    faults: int = 0
    events: int = 0
    commanded: int = 0
    sudden: int = 0
    passed_robot: int = 0
    passed_cloud: int = 0
    pairs: dict[Pair, int] = field(default_factory=dict)
    alarms: dict[str, int] = field(default_factory=dict)
    violation: str = ""
    story: tuple[str, ...] = ()


class Chunk:
    """Everything of one stretch, wired together."""

    def __init__(self, seed: int, index: int) -> None:
        name = f"{seed}/{index}"
        self.world = World(name)
        dice = random.Random(name + "/plan")
        self.scenario = scenarios.draw(dice)
        self.world.inbox_limit = self.scenario.inbox
        self.coverage = Coverage()
        self.observer = Observer(self)
        self.link = Link(
            self.world, base_s=self.scenario.delay_s, jitter_s=self.scenario.jitter_s, drops=self.scenario.drops
        )
        robot_host, cloud_host = Host(self.world, "robot"), Host(self.world, "cloud")
        self.driver = Driver(self.world, robot_host)
        self.robot = RobotSide(self, robot_host)
        self.cloud = CloudSide(self, cloud_host)
        self.silent_inputs: list[int] = []
        self.faults = Faults(self, faults_module.plan(dice), faults_module.plan_ambushes(dice, index))
        self.hands = Hands(self, dice)

    def live(self) -> Outcome:
        """Runs to the end or to the first violation."""
        self.driver.start()
        self.robot.start()
        self.cloud.start()
        for index in range(len(self.scenario.inputs)):
            self._sense(index)
        violation = ""
        story: tuple[str, ...] = ()
        try:
            self.world.run(CHUNK_S)
        except ViolationError as broken:
            violation = f"{broken.invariant}: {broken.text} (at {broken.at_s:.4f} s)"
            story = self._story()
        observer = self.observer
        return Outcome(
            simulated_s=self.world.now,
            faults=sum(self.faults.injected.values()),
            events=self.world.events,
            commanded=observer.changeovers["commanded"],
            sudden=observer.changeovers["sudden"],
            passed_robot=sum(n for site, n in observer.passed_messages.items() if site.value == "robot"),
            passed_cloud=sum(n for site, n in observer.passed_messages.items() if site.value == "cloud"),
            pairs=self.coverage.pairs,
            alarms=observer.alarms,
            violation=violation,
            story=story,
        )

    def _sense(self, index: int) -> None:
        if index not in self.silent_inputs:
            self.robot.data.send("sensors", self.robot.data.input, index)
        self.world.after(self.scenario.input_period_s, self._sense, index)

    def _story(self) -> tuple[str, ...]:
        notes = list(self.world.trace)[-STORY_LENGTH:]
        return tuple(f"{time_s:9.4f}  " + " ".join(str(word) for word in words) for time_s, words in notes)
