"""The robot's four processes around the real core functions: control, pulse, data, collector."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Protocol, cast

from robot_offload_core import beats, collectors, guardians, placement, pulse, switcher
from robot_offload_core.beats import Beat, Permission
from robot_offload_core.envelope import Envelope
from robot_offload_core.events import Acting, Tick
from robot_offload_core.token import Site, Token
from robot_offload_lab.simulate.coverage import collector_state
from robot_offload_lab.simulate.nodes import Message, Node
from robot_offload_lab.simulate.scenario import UID
from robot_offload_lab.simulate.world import Host, Process

if TYPE_CHECKING:
    from robot_offload_lab.simulate.chunk import Chunk

DEADLINE_MARGIN_S = 0.0005
PROBE_S = 0.100
EFFECT_S = 0.037
TEXT_EVERY = 8
"""Every eighth beat crosses as text through the real codec, the others as objects: this keeps the simulation fast."""


class RobotSide:
    """The robot: its host, processes, nodes and inputs."""

    def __init__(self, run: Chunk, host: Host) -> None:
        self.host = host
        self.control = RobotControl(run, host)
        self.pulse = RobotPulse(run, host)
        self.data = RobotData(run, host)
        self.collector = Collector(run, host)
        sources, period_s = run.scenario.sources, run.scenario.settings.robot_period_s
        self.nodes = {
            spec.name: Node(run.world, host, spec, period_s, sources.get(spec.name), self._publish)
            for spec in run.scenario.robot_nodes
        }
        for node in self.nodes.values():
            node.transition_s = run.scenario.transition_s
            node.awake = run.scenario.awake
        self.processes = (self.control, self.pulse, self.data, self.collector)

    def _publish(self, name: str, index: int, message: Message) -> None:
        self.collector.send(name, self.collector.robot_message, index, message)

    def start(self) -> None:
        """Starts everything, the user's nodes first."""
        for process in (*self.nodes.values(), self.collector, self.data, self.pulse):
            process.start()
        self.control.world.after(self.control.run.scenario.late_s[0], self.control.start)


class RobotControl(Process):
    """Placement and guardian: drains what has arrived, ticks every 10 ms."""

    def __init__(self, run: Chunk, host: Host) -> None:
        super().__init__(run.world, host, "robot/control")
        self.run = run
        self.robot = placement.Robot("0" * 32, 0, run.scenario.settings)
        self.guardian = guardians.start((), 0.0)
        self.ready = False

    @property
    def incarnation(self) -> str:
        """Of the present life; the other processes of the side read it."""
        return self.robot.incarnation

    def boot(self) -> None:
        """A new incarnation that knows nothing."""
        scenario = self.run.scenario
        incarnation = f"{self.world.dice.getrandbits(128):032x}"
        started_us = round(self.host.now_s() * 1e6)
        self.robot = placement.Robot(incarnation, started_us, scenario.settings, scenario.inputs)
        self.guardian = guardians.start(scenario.robot_nodes, scenario.settings.activation_deadline_s, has_driver=True)
        self.ready = False
        self.run.observer.robot_started(incarnation)
        self.every(scenario.tick_s, self._tick, first_s=0.0)
        self.every(EFFECT_S, self._effect)

    def _tick(self) -> None:
        self.guard(Tick())
        self.step(Tick())
        self.run.observer.control_ticked()

    def cloud_beat(self, event: placement.CloudBeat) -> None:
        """A beat of the cloud; the loss that follows it, if nothing better comes, is noticed without a tick."""
        self.step(event)
        good_s = self.robot.situation.good_s
        if good_s is not None and switcher.site(self.robot) is Site.CLOUD:
            due_s = good_s + self.robot.settings.loss_timeout_s + DEADLINE_MARGIN_S - self.host.now_s()
            self.world.after(max(0.0, due_s), self._deadline, self.life, good_s)

    def _deadline(self, life: int, good_s: float) -> None:
        if life == self.life and not self.stops and self.robot.situation.good_s == good_s:
            self._tick()

    def _effect(self) -> None:
        if switcher.effects_site(self.robot, self.host.now_s()) is Site.ROBOT:
            self.run.observer.robot_effect(self.robot)

    def step(self, event: placement.Event) -> None:
        """One event through the placement machine."""
        now_s = self.host.now_s()
        self.run.coverage.robot(self.robot, event, now_s)
        self.robot, commands = switcher.step(self.robot, event, now_s)
        for command in commands:
            self._carry_out(command)

    def _carry_out(self, command: placement.Command) -> None:
        run = self.run
        if isinstance(command, Acting):
            known = self.guardian
            told = (command.acting, command.outputs_flow, command.acting and command.in_charge)
            if (known.acting, known.outputs_flow, known.in_charge) != told:
                self.guard(Acting(command.acting, command.outputs_flow, command.in_charge))
        elif isinstance(command, placement.Permit):
            run.observer.permitted(command.permission, self.incarnation)
            run.robot.pulse.send(
                self.name, run.robot.pulse.speak, self.incarnation, command.permission, self.host.now_s()
            )
        elif isinstance(command, placement.SetGate):
            run.observer.gate_said(command.gate)
            run.robot.collector.send(self.name, run.robot.collector.set_gate, command.gate)
        elif isinstance(command, placement.Reopen):
            run.link.pulse.reopen()
            run.link.data.reopen()
        elif isinstance(command, placement.Decided):
            run.observer.robot_decided(command)

    def guard(self, event: guardians.Event) -> None:
        """One event through the guardian; a change of readiness goes to the placement machine."""
        self.guardian, commands = guardians.step(self.guardian, event, self.host.now_s())
        for command in commands:
            if isinstance(command, guardians.Inhibit):
                answered = partial(self._inhibited, self.life)
                self.run.driver.inhibit(command.inhibit, self, answered)
            else:
                call_node(self, self.run.robot.nodes, command)
        ready = guardians.is_ready(self.guardian)
        if ready is not self.ready:
            self.ready = ready
            self.step(placement.NodesReported(ready))

    def _inhibited(self, life: int, value: bool) -> None:
        if life == self.life:
            self.guard(guardians.InhibitAnswered(value))


class Guard(Protocol):
    """What `call_node` needs of a control process."""

    def guard(self, event: guardians.Event) -> None:
        """One event through the guardian."""


def call_node(control: Process, nodes: dict[str, Node], command: guardians.Command) -> None:
    """Calls a node's lifecycle service; an answer to an earlier life of control, or after the deadline, is lost."""
    life, world = control.life, control.world
    guard = cast(Guard, control).guard

    if isinstance(command, guardians.ChangeState):
        until_s = world.now + command.deadline_s

        def changed(transition: guardians.Transition, success: bool) -> None:
            if control.life == life and world.now <= until_s:
                guard(guardians.Answered(command.name, transition, success))

        nodes[command.name].change_state(command.transition, control, changed)
    elif isinstance(command, guardians.GetState):
        until_s = world.now + command.deadline_s

        def read(state: guardians.State) -> None:
            if control.life == life and world.now <= until_s:
                guard(guardians.Observed(command.name, state))

        nodes[command.name].get_state(control, read)


class RobotPulse(Process):
    """Beats only."""

    def __init__(self, run: Chunk, host: Host) -> None:
        super().__init__(run.world, host, "robot/pulse")
        self.run = run
        self.state = pulse.Pulse(UID, Site.ROBOT, run.scenario.settings.beat_period_s)

    def boot(self) -> None:
        """Knows no permission and has heard nobody."""
        period_s = self.run.scenario.settings.beat_period_s
        self.state = pulse.Pulse(UID, Site.ROBOT, period_s)
        if self.life > 1:
            self.run.link.pulse.reopen()
        self.every(period_s, self._beat, first_s=0.0)

    def speak(self, incarnation: str, permission: Permission, said_s: float) -> None:
        """Control has renewed its permission."""
        self.state = pulse.speak(self.state, incarnation, permission, said_s)

    def _beat(self) -> None:
        run, now_s = self.run, self.host.now_s()
        self.state, beat = pulse.compose(self.state, now_s, self.host.wall_us)
        body = beat.body
        granted = isinstance(body, Permission) and body.granted
        run.observer.beat_sent(beat)
        target = run.cloud.pulse
        run.link.pulse.up.carry(target.deliver, target.hear, written(beat), self.world.now)
        run.robot.control.send(self.name, run.robot.control.step, placement.PulseSent(now_s, granted))

    def hear(self, sent: Beat | str, _sent_s: float) -> None:
        """Something arrived on the pulse session."""
        beat = read(sent)
        if beat is None:
            return
        run, now_s = self.run, self.host.now_s()
        self.state, newer = pulse.hear(self.state, beat, now_s)
        if newer:
            run.observer.cloud_beat(beat, now_s)
            control = run.robot.control
            control.send(self.name, control.cloud_beat, placement.CloudBeat(beat, now_s, self.host.wall_us))
            run.robot.data.send(self.name, run.robot.data.beat_heard, beat.incarnation, beat.sent_us)


def written(beat: Beat) -> Beat | str:
    """What crosses the link for a beat."""
    return beats.encode(beat) if beat.sequence % TEXT_EVERY == 0 else beat


def read(sent: Beat | str) -> Beat | None:
    """What arrived, None for garbage."""
    if isinstance(sent, Beat):
        return sent
    try:
        return beats.decode(sent)
    except beats.BeatError:
        return None


class RobotData(Process):
    """Inputs out, envelopes in."""

    def __init__(self, run: Chunk, host: Host) -> None:
        super().__init__(run.world, host, "robot/data")
        self.run = run
        self.heard_us: dict[str, int] = {}
        self.cloud = ""
        self.probe_s: float | None = None
        self.sequences = [0] * len(run.scenario.inputs)

    def boot(self) -> None:
        """Has heard nothing."""
        self.heard_us = {}
        self.cloud = ""
        self.probe_s = None
        self.sequences = [0] * len(self.sequences)
        if self.life > 1:
            self.run.link.data.reopen()
        self.every(PROBE_S, self._probe)
        self.every(self.run.scenario.report_s, self._report)

    def beat_heard(self, incarnation: str, sent_us: int) -> None:
        """The pulse process heard a beat: the echo reference of what we send."""
        self.heard_us = {incarnation: sent_us}

    def _probe(self) -> None:
        target = self.run.cloud.data
        self.run.link.data.up.carry(target.deliver, target.probe, self.run.robot.control.incarnation)

    def probe(self, cloud: str) -> None:
        """A probe of the cloud's data process."""
        self.cloud, self.probe_s = cloud, self.host.now_s()

    def _report(self) -> None:
        age_s = None if self.probe_s is None else self.host.now_s() - self.probe_s
        control = self.run.robot.control
        event = placement.DataReported(self.run.link.data.connected, age_s, self.cloud)
        control.send(self.name, control.step, event)

    def input(self, index: int) -> None:
        """A message of an input arrived from the robot's sensors."""
        self.sequences[index] += 1
        cloud, echo_us = next(iter(self.heard_us.items()), ("", 0))
        token = Token(self.run.robot.control.incarnation, 0, cloud)
        target = self.run.cloud.data
        envelope = Envelope(token, self.sequences[index], echo_us)
        self.run.link.data.up.carry(target.deliver, target.input, index, envelope)

    def envelope(self, index: int, envelope: Envelope, message: Message, left_s: float) -> None:
        """A message of the cloud; it goes to the collector."""
        collector = self.run.robot.collector
        collector.send(self.name, collector.cloud_message, index, envelope, message, left_s)

    def effect(self, token: Token) -> None:
        """A request of the cloud for an effect that is not collected."""
        collector = self.run.robot.collector
        collector.send(self.name, collector.cloud_effect, token)


class Collector(Process):
    """The gate; keeps (charge, started_us, fell_back) over its own restarts."""

    def __init__(self, run: Chunk, host: Host) -> None:
        super().__init__(run.world, host, "robot/collector")
        self.run = run
        self.kept: tuple[collectors.Charge, int, bool] | None = None
        self.sequence = 0
        self.held: dict[int, tuple[Message, Envelope | None, float]] = {}
        self.state = self._fresh()

    def _fresh(self) -> collectors.Collector:
        scenario = self.run.scenario
        return collectors.start(scenario.outputs, scenario.settings.max_command_age_s, scenario.settings.lease_s)

    def boot(self) -> None:
        """Takes up what an earlier life had kept."""
        self.sequence = 0
        self.held.clear()
        self.state = self._fresh()
        if self.kept is not None:
            self.state = collectors.resume(self.state, *self.kept, self.host.now_s())
            self.run.faults.entered("collector resumed")
        self.every(self.run.scenario.report_s, self._tick)

    def _tick(self) -> None:
        state = collectors.turn(self.state, self.host.now_s())
        silent = state.fell_back and not self.state.fell_back
        self.run.coverage.collector(self.state, "tick: control silent" if silent else "tick")
        self._keep(state)
        self._report()

    def _report(self) -> None:
        control = self.run.robot.control
        control.send(self.name, control.step, placement.GateReported(collectors.report(self.state, self.host.now_s())))

    def _keep(self, state: collectors.Collector) -> None:
        before, self.state = self.state, state
        if state.charge is not None:
            self.kept = (state.charge, state.started_us, state.fell_back)
        if state is not before and (state.charge, state.next, state.fell_back) != (
            before.charge, before.next, before.fell_back
        ):  # fmt: skip
            self.run.faults.entered("collector " + collector_state(state))
        if state.charge is not before.charge and state.charge != before.charge:
            charge = state.charge
            self.run.world.note("collector passes", charge and charge.site.value, charge and charge.token.epoch)
            self._report()

    def set_gate(self, gate: collectors.Gate) -> None:
        """Control's wish."""
        self.run.coverage.gate(self.state, gate)
        self._keep(collectors.set_gate(self.state, gate, self.host.now_s()))

    def robot_message(self, index: int, message: Message) -> None:
        """The robot's replica has published."""
        self.sequence += 1
        before = self.state
        self.run.coverage.collector(before, "robot message")
        state, passage = collectors.offer_robot(before, index, self.sequence, self.host.now_s())
        self._keep(state)
        self._pass(Site.ROBOT, index, passage, (message, None, self.world.now))

    def cloud_message(self, index: int, envelope: Envelope, message: Message, left_s: float) -> None:
        """A message of the cloud's replica has arrived."""
        before, now_s = self.state, self.host.now_s()
        self.run.coverage.cloud_message(before, index, envelope, now_s)
        state, passage = collectors.offer_cloud(before, index, envelope, now_s)
        self._keep(state)
        self._pass(Site.CLOUD, index, passage, (message, envelope, left_s))

    def _pass(
        self, site: Site, index: int, passage: collectors.Passage, offered: tuple[Message, Envelope | None, float]
    ) -> None:
        """Publishes what passes, keeps what may pass at the changeover."""
        self.run.coverage.passage(site, passage.reason)
        if passage.reason == "NotAllReady":
            self.held[index] = offered
        passing = [(index, offered)] if passage.passes else []
        if passage.reason == "ChangedOver":
            passing = [*((i, self.held[i]) for i in passage.also), *passing]
            self.held.clear()
            self.run.observer.flipped()
        for at, (message, envelope, left_s) in passing:
            if at == 0:
                self.run.driver.command()
            self.run.observer.passed(site, at, message, envelope, left_s)

    def cloud_effect(self, token: Token) -> None:
        """A request of the cloud: admitted from the holder of the token only."""
        self.run.coverage.effect(self.state, token)
        passage = collectors.admits_effect(self.state, token, self.host.now_s())
        if passage.passes:
            self.run.observer.cloud_effect(token)
