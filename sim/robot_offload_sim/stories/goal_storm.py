"""Storms with goals and calls: ordinary stretches, with relays, servers of various behaviour, and busy clients."""

from __future__ import annotations

import random
from dataclasses import replace

from robot_offload_core.fence.token import Site
from robot_offload_core.words.declared import SnapshotState
from robot_offload_sim.chunk import Chunk, Outcome
from robot_offload_sim.sides.handing import Handing
from robot_offload_sim.stories.goal_stage import CLEAR, COUNT, DOCK, FOLLOW, LAMP, LIFT, PLAN, RELAY, SPIN
from robot_offload_sim.world import scenario as scenarios
from robot_offload_sim.world.scenario import Scenario
from robot_offload_sim.world.violations import ViolationError
from robot_offload_sim.world.world import World

ACTS_PER_S = 2.0
PREPARE_S = 2.0
DECIDED_WITHIN_S = 25.0
"""The longest goal (8 s), its deadlines, a relay stopped meanwhile: every older goal has its result."""
RESTART_S = 0.3
EVERY = 6
"""Every sixth stretch of the storms."""


def drawn(dice: random.Random) -> Scenario:
    """Return a scenario of the storms in which services and actions are served."""
    scenario = scenarios.draw(dice)
    return replace(
        scenario,
        relay=RELAY,
        settings=replace(scenario.settings, prepare_deadline_s=PREPARE_S),
        cloud_settings=replace(scenario.cloud_settings, prepare_deadline_s=PREPARE_S),
    )


def drawn_with_state(dice: random.Random) -> Scenario:
    """Return such a scenario in which the controller has state as well."""
    return replace(drawn(dice), states={"controller_1": SnapshotState("controller", max_age_s=0.5, max_size=1024)})


class Demands:
    """What clients, replicas and faults do to the relays: goals, cancels, calls, deaths, stops."""

    def __init__(self, world: World, handing: Handing, dice: random.Random) -> None:
        self.world = world
        self.handing = handing
        self.dice = dice
        for servers in handing.servers.values():
            for action in (FOLLOW, SPIN, DOCK):
                traits = servers.traits[action]
                traits.takes_s = dice.choice((0.5, 3.0, 8.0))
                traits.single = dice.random() < 0.5
                traits.accept_s = dice.choice((0.0, 0.0, 0.3))
        handing.outside.servers.traits[LIFT].takes_s = dice.choice((0.5, 3.0, 8.0))
        world.after(2.0, self._act)

    def _act(self) -> None:
        dice, handing = self.dice, self.handing
        self.world.after(dice.expovariate(ACTS_PER_S), self._act)
        acts = (
            (self._send, 40),
            (self._cancel, 10),
            (self._call, 35),
            (self._use, 10),
            (self._kill, 2),
            (self._stop, 1),
        )
        act = dice.choices([a for a, _ in acts], [share for _, share in acts])[0]
        if handing.robot.alive:
            act()

    def _send(self) -> None:
        self.handing.clients.send(self.dice.choice((FOLLOW, FOLLOW, SPIN, DOCK)))

    def _cancel(self) -> None:
        running = [goal for goal in self.handing.clients.goals.values() if goal.open]
        if running:
            goal = self.dice.choice(running)
            self.handing.clients.cancel(goal.action, goal)

    def _call(self) -> None:
        self.handing.clients.call(self.dice.choice((PLAN, COUNT, CLEAR)))

    def _use(self) -> None:
        site = self.dice.choice(list(Site))
        if (self.handing.robot if site is Site.ROBOT else self.handing.cloud).alive:
            self.handing.clients.use(site, LAMP)
            self.handing.outside.send(site, LIFT)

    def _kill(self) -> None:
        self.dice.choice(self.handing.processes).kill(RESTART_S)

    def _stop(self) -> None:
        self.dice.choice(self.handing.processes).stop_for(self.dice.random())


def with_goals(index: int) -> bool:
    """Return whether a stretch of the storms has goals and calls."""
    return index % EVERY == EVERY - 3


def live(seed: int, index: int, *, state: bool = False) -> Outcome:
    """Run one stretch, with `state` always; the end of each goal and call is judged too."""
    chunk = Chunk(seed, index, drawn_with_state if state else drawn)
    handing = chunk.system.handing
    assert handing is not None
    Demands(chunk.system.world, handing, random.Random(f"{seed}/{index}/goals"))
    outcome = chunk.live()
    outcome.goals_s = outcome.simulated_s
    outcome.state_s = outcome.simulated_s if chunk.system.keeping is not None else 0.0
    if not outcome.violation:
        try:
            handing.clients.finish(DECIDED_WITHIN_S)
        except ViolationError as broken:
            outcome.violation = f"{broken.invariant}: {broken.text}"
    return outcome
