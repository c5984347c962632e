"""The collector process of the robot in virtual time."""

from __future__ import annotations

import math

from robot_offload_core.collector import gate
from robot_offload_core.collector.process import CollectorPlan, CollectorProcess
from robot_offload_core.collector.state import Collector
from robot_offload_core.fence.gate import Charge
from robot_offload_core.fence.token import Site, Token
from robot_offload_core.words.gates import Passage
from robot_offload_core.words.messages import Carried, SetGate
from robot_offload_sim.sides.shells import LOOK_S, TYPE, Shell
from robot_offload_sim.world.coverage import collector_state
from robot_offload_sim.world.nodes import Message
from robot_offload_sim.world.ports import Payload, Surroundings, decoded
from robot_offload_sim.world.world import Host


class WatchedCollector(CollectorProcess):
    """The core's class, with passages counted for coverage and changes of the passing side shown."""

    around: Surroundings

    def _count(self, side: str, index: int, passage: Passage) -> None:
        self.around.coverage.passage(Site(side), passage.reason)
        super()._count(side, index, passage)

    def _keep(self, state: Collector) -> bool:
        before = self.state
        if (state.charge, state.next, state.fell_back) != (before.charge, before.next, before.fell_back):
            self.around.entered("collector " + collector_state(state))
        if state.charge != before.charge and (charge := state.charge) is not None:
            if charge == before.next:
                self.around.witness.flipped(before.charge)
            self.around.world.note("collector passes", charge.site.value, charge.token.epoch)
        return super()._keep(state)


class CollectorShell(Shell):
    """The gate. `kept`: its memory file, which outlives the process. `rivals`: other publishers of output 0's topic."""

    def __init__(self, around: Surroundings, host: Host, peers: dict[str, Shell]) -> None:
        super().__init__(around, host, "collector", peers)
        scenario = around.scenario
        self.plan = CollectorPlan(
            scenario.outputs, tuple(o.mirrored for o in scenario.data_plan.outputs),
            scenario.settings.max_command_age_s, scenario.settings.lease_s,
            scenario.settings.loss_timeout_s, scenario.settings.activation_deadline_s,
        )  # fmt: skip
        self.kept: tuple[Charge, int, bool, int] | None = None
        self.look_s = math.inf
        self.rivals: list[str] = []
        self.process = WatchedCollector(self.plan, self)

    @property
    def state(self) -> Collector:
        """Return the state of the machine."""
        return self.process.state

    def boot(self) -> None:
        """Resume from what an earlier life had kept."""
        self.process = WatchedCollector(self.plan, self, self.kept)
        self.process.around = self.around
        if self.kept is not None:
            self.around.entered("collector resumed")
        self.every(self.around.scenario.report_s, self._turn)
        self.look_s = math.inf
        if "second publisher" in self.around.scenario.worlds:
            self.every(LOOK_S, lambda: self.process.rival(0, self.rivals))

    def _plan_look(self) -> None:
        """Plan the check for a message of the cloud that would be missing then."""
        due_s = self.process.look_due_s()
        if due_s < self.look_s:
            self.look_s = due_s
            self.once(max(0.0, due_s - self.host.now_s()), self._look)

    def _look(self) -> None:
        self.look_s = math.inf
        self.process.woke()
        self.process.report(only_news=True)
        self._plan_look()

    def _turn(self) -> None:
        self.process.woke()
        state = self.process.state
        silent = gate.turn(state, self.host.now_s()).fell_back and not state.fell_back
        self.around.coverage.collector(state, "tick: control silent" if silent else "tick")
        self.process.report(only_news=True)

    def take(self, message: object) -> None:
        """Take a datagram."""
        self.process.woke()
        coverage = self.around.coverage
        if isinstance(message, SetGate):
            coverage.gate(self.process.state, message.gate)
        elif isinstance(message, Carried):
            coverage.cloud_message(self.process.state, message.index, decoded(message.header), self.host.now_s())
        before = self.process.state.charge
        self.process.handle(message)
        self._plan_look()
        following = message.gate.next if isinstance(message, SetGate) else None
        if following is not None and before != following == self.process.state.charge:
            self.around.witness.flipped(before)  # no message was needed: it changed over when armed

    def robot_message(self, index: int, message: Message) -> None:
        """Take what the robot's replica has published."""
        self.around.coverage.collector(self.process.state, "robot message")
        self.process.offer_robot(index, Payload(Site.ROBOT, message, b"", self.world.now))

    def cloud_effect(self, token: Token) -> None:
        """Take a request of the cloud, which is admitted only from the holder of the token."""
        self.around.coverage.effect(self.process.state, token)
        if gate.admits_effect(self.process.state, token, self.host.now_s()).passes:
            self.around.witness.cloud_effect(token)

    # -- ports of the core's process ----------------------------------------------------------------------------------

    def publish(self, index: int, payload: Payload) -> None:
        """Publish to the consumers; output 0 drives the wheels."""
        if index == 0:
            self.around.driver.command()
        self.around.witness.passed(index, payload)
        if index in self.process.loops:  # we also listen on the public topic of a shared output
            self.post(self.name, self.others, index, payload)

    def others(self, index: int, payload: Payload) -> None:
        """Take a message of the public topic of a shared output, ours and others' alike."""
        self.process.hear_others(index, payload)

    def fill(self, index: int, payload: Payload) -> None:
        """Publish on the private topic: the replica receives it, and so do we."""
        self.around.witness.filled(Site.ROBOT, index, payload)
        self.post(self.name, self.process.offer_robot, index, payload)

    def type_of(self, _index: int) -> str:
        """Return the one type that all payloads here have."""
        return TYPE

    def topics_of(self, index: int) -> tuple[str, str]:
        """Return the topics of an output, for messages."""
        name = self.plan.outputs[index].name
        return f"/{name}", f"/robot/{name}"

    def save(self, state: Collector) -> None:
        """Save which side passes."""
        if state.charge is not None:
            self.kept = (state.charge, state.started_us, state.fell_back, state.stay)

    def fell_silent(self) -> None:
        """Keep a note for the story."""
        self.world.note("collector: control is silent")
