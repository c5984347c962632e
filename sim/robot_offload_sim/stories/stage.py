"""A stage for stories: one small world in virtual time with a script, for one rule each.

A story is a function that takes a `Stage` and raises `StoryError` (or an invariant breaks) when the rule does not hold.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

from robot_offload_core.control.robot import placement
from robot_offload_core.control.robot.availability import Available
from robot_offload_core.control.robot.placement import Robot, Wish
from robot_offload_core.data.process import InputPlan
from robot_offload_core.fence.token import Site
from robot_offload_core.words.decided import Decided, Phase
from robot_offload_core.words.lifecycle import State
from robot_offload_core.words.settings import NodeSpec, OutputSpec, Settings
from robot_offload_sim.promises.observer import Observer
from robot_offload_sim.promises.promises import OTHERS
from robot_offload_sim.sides.system import System
from robot_offload_sim.world.ports import Payload
from robot_offload_sim.world.scenario import Replica, Scenario
from robot_offload_sim.world.world import Process

STEP_S = 0.001
SETTLE_S = 8.0
WHEELS = NodeSpec("wheels", duplicated=False, core=True)
CONTROLLER = NodeSpec("controller", core=True)
ARM = NodeSpec("arm", core=True)
STRANGER = "ee" * 16
"""The incarnation of an agent other than the two."""
PLANNER = NodeSpec("planner")


class StoryError(Exception):
    """What a story expects did not happen."""


@dataclass(frozen=True)
class Passed:
    """A message at the consumer: when (true time), of which site and output, when it was born, and whether others'."""

    at_s: float
    site: Site
    index: int
    born_s: float
    others: bool = False


class Recorder(Observer):
    """The observer, which also keeps everything for the story."""

    def __init__(self, run: System, quiet_s: Callable[[], float]) -> None:
        super().__init__(run, quiet_s)
        self.messages: list[Passed] = []
        self.in_cloud: list[Passed] = []
        self.decisions: list[tuple[float, Decided]] = []
        self.answers: list[tuple[int, bool, str]] = []
        self.left: list[float] = []
        self.fills: list[tuple[float, Site, Passed]] = []
        self.statements: list[tuple[float, Available]] = []

    def passed(self, index: int, payload: Payload) -> None:
        """Keep a message, after its invariants were checked."""
        super().passed(index, payload)
        self.messages.append(Passed(self.world.now, payload.site, index, payload.message.born_s))

    def heard_in_cloud(self, index: int, payload: Payload) -> None:
        """Keep a message of the cloud's consumers."""
        super().heard_in_cloud(index, payload)
        others = payload.message.producer == OTHERS
        self.in_cloud.append(Passed(self.world.now, payload.site, index, payload.message.born_s, others))

    def filled(self, side: Site, index: int, payload: Payload) -> None:
        """Keep what a replica of a shared output was given, after its invariant was checked."""
        super().filled(side, index, payload)
        others = payload.message.producer == OTHERS
        given = Passed(self.world.now, payload.site, index, payload.message.born_s, others)
        self.fills.append((self.world.now, side, given))

    def robot_decided(self, decided: Decided) -> None:
        """Keep a decision."""
        super().robot_decided(decided)
        self.decisions.append((self.world.now, decided))

    def left_cloud(self, token: Any) -> None:
        """Keep when something left the cloud."""
        super().left_cloud(token)
        if token.epoch:
            self.left.append(self.world.now)

    def available(self, statements: tuple[Available, ...]) -> None:
        """Keep what is stated of the nodes with placement Cloud."""
        super().available(statements)
        self.statements += [(self.world.now, statement) for statement in statements]

    def answered(self, key: int, accepted: bool, message: str) -> None:
        """Keep an answer."""
        self.answers.append((key, accepted, message))


def plain(**changes: Any) -> Scenario:
    """Return a small scenario: wheels, a controller that drives them, a planner without an output."""
    settings = changes.pop("settings", Settings(hold_down_initial_s=1.0, flap_window_s=3.0, hold_down_max_s=4.0))
    hot = changes.pop("hot", False)
    cloud_only: tuple[NodeSpec, ...] = changes.pop("cloud_only", ())
    nodes: tuple[NodeSpec, ...] = changes.pop("nodes", (CONTROLLER, PLANNER))
    outputs: tuple[OutputSpec, ...] = changes.pop("outputs", (OutputSpec("cmd_vel", 0.15),))
    replicas: dict[str, Replica] = changes.pop("replicas", {"controller": Replica(0, settings.robot_period_s)})
    cloud_replicas = {
        name: replace(r, period_s=min(r.period_s, settings.cloud_period_s)) if r.period_s < 1 else r
        for name, r in replicas.items()
    }
    others = {spec.name: Replica() for spec in (WHEELS, *nodes, *cloud_only)}
    given: dict[str, Any] = {
        "settings": settings,
        "cloud_settings": settings,
        "outputs": outputs,
        "mirrored": (0,),
        "inputs": (InputPlan("scan", 300), InputPlan("map", latched=True)),
        "input_periods_s": (0.05, 60.0),
        "robot_nodes": (WHEELS, *(replace(n, hot=hot or n.hot) for n in nodes)),
        "cloud_nodes": (*nodes, *cloud_only),
        "replicas": others | replicas,
        "cloud_replicas": others | cloud_replicas,
    }
    settings.check()
    return Scenario(**(given | changes))


class Stage:
    """One world, its script and what happened so far."""

    def __init__(self, name: str = "story", **changes: Any) -> None:
        self.scenario = plain(**changes)
        self.system = System(self.scenario, name)
        self.seen = Recorder(self.system, lambda: 0.0)
        self.system.around.witness = self.seen
        self.world, self.link = self.system.world, self.system.link
        self.robot, self.cloud, self.driver = self.system.robot, self.system.cloud, self.system.driver

    # -- time ---------------------------------------------------------------------------------------------------------

    @property
    def now(self) -> float:
        """Return true time."""
        return self.world.now

    def run(self, seconds: float) -> None:
        """Let time pass."""
        self.world.run(self.world.now + seconds)

    def until(self, condition: Callable[[], bool], within_s: float, what: str) -> float:
        """Let time pass until something holds; return after how long; raise StoryError when that takes too long."""
        start_s = self.now
        while not condition():
            if self.now - start_s > within_s:
                raise StoryError(f"not within {within_s:g} s: {what}")
            self.run(STEP_S)
        return self.now - start_s

    def always(self, condition: Callable[[], bool], for_s: float, what: str) -> None:
        """Let time pass while something must hold."""
        end_s = self.now + for_s
        while self.now < end_s:
            self.expect(condition(), what)
            self.run(STEP_S)

    def expect(self, condition: bool, what: str) -> None:
        """Raise StoryError unless the condition holds."""
        if not condition:
            raise StoryError(f"at {self.now:.3f} s: {what}")

    # -- the machines -------------------------------------------------------------------------------------------------

    @property
    def machine(self) -> Robot:
        """Return the state of the placement machine."""
        return self.robot.control.robot

    @property
    def phase(self) -> Phase:
        """Return the phase."""
        return self.machine.phase

    @property
    def armed(self) -> bool:
        """Return whether the collector may change over at the first messages of the side that gets ready."""
        preparation = self.machine.preparation
        return preparation is not None and preparation.armed

    @property
    def offered(self) -> bool:
        """Return whether the collector was given the present preparation of the cloud."""
        return self.machine.grant.offered

    @property
    def site(self) -> Site:
        """Return the side in charge."""
        return placement.IN_CHARGE[self.phase]

    def start(self, *, cloud: bool = True) -> None:
        """Start everything; without the cloud when asked so."""
        self.system.start()
        if not cloud:
            for process in (*self.cloud.processes, *self.cloud.nodes.values()):
                process.kill(1e9)
                self.world.at(0.8, process.kill, 1e9)

    def robot_acts(self) -> None:
        """Wait until the robot's nodes act."""
        self.until(lambda: self.phase is Phase.ROBOT and self.machine.nodes_ready, 3.0, "the robot acts")

    def in_cloud(self) -> None:
        """Start, and wait until the cloud is in charge and all is calm."""
        self.start()
        self.until(lambda: self.phase is Phase.CLOUD, SETTLE_S, "the cloud is in charge")
        self.run(0.5)
        self.expect(self.phase is Phase.CLOUD, "the cloud stays in charge")

    # -- what happens -------------------------------------------------------------------------------------------------

    def cut(self, way: str = "both", sessions: str = "both") -> Callable[[], None]:
        """Cut the link (one direction or both, of pulse, data or both); return the function that restores it."""
        chosen = {"both": (self.link.pulse, self.link.data), "pulse": (self.link.pulse,), "data": (self.link.data,)}
        wires = [w for s in chosen[sessions] for w in ((s.up, s.down) if way == "both" else (getattr(s, way),))]
        for wire in wires:
            wire.cut_lost += 1

        def join() -> None:
            for wire in wires:
                wire.cut_lost -= 1

        return join

    def by_hand(self, site: Site, key: int = 1) -> bool:
        """Ask for a side; return whether that was accepted."""
        self.robot.control.step(placement.SwitchByHand(site, key))
        return next(accepted for k, accepted, _ in reversed(self.seen.answers) if k == key)

    def answered(self, key: int, accepted: bool) -> bool:
        """Return whether a request was answered like this."""
        return (key, accepted) in [(k, ok) for k, ok, _ in self.seen.answers]

    def pin(self, site: Site | None, for_s: float | None = None) -> None:
        """Pin placement on the robot, or remove the pin."""
        until_s = None if for_s is None else self.robot.host.now_s() + for_s
        self.robot.control.step(placement.SetPin(None if site is None else Wish(site, until_s)))

    def deaf(self, sender: str, to: str, for_s: float) -> None:
        """Lose what one process of the robot sends to another, as a full inbox does."""
        peers = dict(self.robot.control.peers)
        process = peers[sender]
        process.peers = {name: peer for name, peer in peers.items() if name != to}
        self.world.after(for_s, setattr, process, "peers", self.robot.control.peers)

    def stall(self, process: Process, for_s: float) -> None:
        """Stop a process for a while (SIGSTOP)."""
        process.stop_for(for_s)

    def starve(self, process: Process, off_s: float, on_s: float, for_s: float) -> None:
        """Give a process its processor time in slices."""
        end_s = self.now + for_s

        def slice_() -> None:
            if self.now < end_s:
                process.stop_for(off_s)
                self.world.after(off_s + on_s, slice_)

        slice_()

    def hush(self, side: str, node: str = "controller") -> None:
        """Let a node stay Active but stop publishing."""
        getattr(self, side).nodes[node].hung += 1

    # -- judging ------------------------------------------------------------------------------------------------------

    def first_message(self, after_s: float, site: Site, index: int = 0) -> float | None:
        """Return when the consumer heard a side for the first time after `after_s`."""
        found = (m.at_s for m in self.seen.messages if m.at_s > after_s and m.site is site and m.index == index)
        return next(found, None)

    def until_heard(self, after_s: float, site: Site, within_s: float, what: str) -> None:
        """Wait until the consumer hears a side, for the first time after `after_s`."""
        self.until(lambda: self.first_message(after_s, site) is not None, within_s, what)

    def until_inhibited(self, within_s: float, what: str) -> None:
        """Wait until the driver is inhibited."""
        self.until(lambda: self.driver.inhibited, within_s, what)

    def until_phase(self, phase: Phase, within_s: float, what: str) -> None:
        """Wait for a phase."""
        self.until(lambda: self.phase is phase, within_s, what)

    def longest_gap(self, from_s: float, index: int = 0) -> float:
        """Return the longest silence of an output at the consumer since `from_s`, until now."""
        times = [from_s, *(m.at_s for m in self.seen.messages if m.at_s >= from_s and m.index == index), self.now]
        return max(later - earlier for earlier, later in pairwise(times))

    def active(self, side: str, node: str = "controller") -> bool:
        """Return whether a node is Active."""
        return bool(getattr(self, side).nodes[node].state is State.ACTIVE)

    def lost(self, within_s: float, what: str) -> float:
        """Wait for a sudden loss; return after how long control decided it."""
        before = self.seen.changeovers["sudden"]
        return self.until(lambda: self.seen.changeovers["sudden"] > before, within_s, what)
