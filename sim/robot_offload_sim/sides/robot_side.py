"""The robot's four processes: the core's own classes, driven by virtual time instead of sockets and threads."""

from __future__ import annotations

from functools import partial
from typing import Any

from robot_offload_core.control.nodes.guardians import Guardian, InhibitAnswered
from robot_offload_core.control.nodes.managed_nodes import Command, Inhibit
from robot_offload_core.control.robot import placement, switcher
from robot_offload_core.control.robot.availability import Available
from robot_offload_core.control.robot.process import RobotControlProcess, RobotPlan
from robot_offload_core.data.robot import RobotDataProcess
from robot_offload_core.fence.token import Site
from robot_offload_core.pulse import pulse
from robot_offload_core.words.beats import Beat, Permission
from robot_offload_core.words.decided import Decided
from robot_offload_core.words.events import StateReported
from robot_offload_core.words.messages import Heard, Limits, Notes, PulseSent, Reopen, SetGate, Speak
from robot_offload_core.words.settings import Settings
from robot_offload_sim.sides.robot_collector import CollectorShell
from robot_offload_sim.sides.shells import (
    EFFECT_S,
    LOOK_S,
    DataShell,
    PulseShell,
    Shell,
    call_node,
    plain_nodes_seen,
    read,
    written,
)
from robot_offload_sim.world.nodes import Message, Node
from robot_offload_sim.world.ports import Sensed, Surroundings
from robot_offload_sim.world.scenario import UID
from robot_offload_sim.world.since import Since
from robot_offload_sim.world.world import Host, Process

LEAVING_S = 25.0
"""As in the agent: how long the robot does not choose a cloud whose pods are going."""
LIMITS_S = 1.0


class RobotSide:
    """The robot: its host, processes, nodes and inputs."""

    def __init__(self, around: Surroundings, host: Host) -> None:
        self.around = around
        self.host = host
        peers: dict[str, Shell] = {}
        self.control = RobotControl(around, host, peers)
        self.pulse = RobotPulse(around, host, peers)
        self.data = RobotData(around, host, peers)
        self.collector = CollectorShell(around, host, peers)
        self.processes: tuple[Process, ...] = (self.control, self.pulse, self.data, self.collector)
        scenario = around.scenario
        self.nodes = {
            spec.name: Node(around.world, host, spec, scenario.replicas[spec.name], self._publish)
            for spec in scenario.robot_nodes
        }
        for node in self.nodes.values():
            node.transition_s = scenario.transition_s
            node.awake = scenario.awake
        self.control.nodes = self.nodes
        around.link.pulse.down.target = self.pulse, self.pulse.hear
        around.link.data.down.target = self.data, self.data.arrived

    def _publish(self, name: str, index: int, message: Message) -> None:
        self.collector.post(name, self.collector.robot_message, index, message)

    def start(self) -> None:
        """Start everything, the user's nodes first."""
        for process in (*self.nodes.values(), self.collector, self.data, self.pulse):
            process.start()
        self.around.world.after(self.around.scenario.late_s[0], self.control.start)


class WatchedControl(RobotControlProcess):
    """The core's class, with every event of its machine counted for coverage."""

    watch: Any

    def step(self, event: placement.Event) -> None:
        """Count the event, then take it."""
        if not isinstance(event, placement.RelayReported | StateReported | placement.WhileReported):
            self.watch(self.robot, event, self.ports.now_s())
        super().step(event)


class RobotControl(Shell):
    """The robot's control in virtual time.

    Attributes:
        in_force: settings that hold; like those on the robot's disk they outlive the process.
    """

    def __init__(self, around: Surroundings, host: Host, peers: dict[str, Shell]) -> None:
        super().__init__(around, host, "control", peers)
        self.nodes: dict[str, Node] = {}
        self.in_force: Settings = around.scenario.settings
        self.process = self._made("0" * 32)
        self.deadline_s = 0.0

    @property
    def robot(self) -> placement.Robot:
        """Return the state of the placement machine."""
        return self.process.robot

    @property
    def guardian(self) -> Guardian:
        """Return the state of the guardian."""
        return self.process.guardian

    def _made(self, incarnation: str) -> WatchedControl:
        scenario = self.around.scenario
        plan = RobotPlan(
            scenario.settings,
            self.in_force,
            scenario.input_specs,
            scenario.robot_nodes,
            has_driver=True,
            outputs=scenario.outputs,
            publishers=scenario.publishers,
            strict=scenario.strict,
            has_relay=scenario.relay is not None,
            has_state=bool(scenario.states),
            shape=scenario.shape(Site.ROBOT),
        )
        process = WatchedControl(plan, self, incarnation, round(self.host.now_s() * 1e6))
        process.watch = self.around.coverage.robot
        return process

    def boot(self) -> None:
        """Start a new incarnation that knows nothing."""
        incarnation = f"{self.world.dice.getrandbits(128):032x}"
        self.process = self._made(incarnation)
        self.blink_s = self.in_force.stall_s
        self.around.witness.robot_started(incarnation)
        self.around.controlled(self.process)
        self.every(self.around.scenario.tick_s, self.turn, first_s=0.0)
        self.every(EFFECT_S, self._effect)
        self.every(LIMITS_S, self._limits)
        self.every(LOOK_S, lambda: self.process.guard(plain_nodes_seen(self.nodes)), first_s=0.1)

    def turn(self) -> None:
        """Take a turn."""
        self.process.turn()
        self.around.witness.control_ticked()

    def take(self, message: object) -> None:
        """Take a datagram."""
        if isinstance(message, Notes):
            if message.incarnation == self.robot.link.peer:
                self.process.announce_leaving(message.text, self.host.now_s() + LEAVING_S)
            return
        self.process.handle(message)

    def beat(self, beat: Beat, arrived_s: float, wall_us: int, sent: PulseSent | None) -> None:
        """Take a beat of the cloud; the loss that may follow is noticed to the millisecond."""
        self.process.arrived(beat, arrived_s, wall_us, sent)
        deadline_s = self.process.next_deadline_s()
        if deadline_s != self.deadline_s and deadline_s < float("inf"):
            self.deadline_s = deadline_s
            self.world.after(max(0.0, deadline_s - self.host.now_s()), self._deadline, self.life, deadline_s)

    def _deadline(self, life: int, deadline_s: float) -> None:
        if life == self.life and not self.stops and self.process.next_deadline_s() == deadline_s:
            self.turn()

    def _effect(self) -> None:
        if switcher.effects_site(self.robot, self.host.now_s()) is Site.ROBOT:
            self.around.witness.robot_effect(self.robot)

    def step(self, event: placement.Event) -> None:
        """Take what a person does."""
        self.process.step(event)

    def adopt(self, settings: Settings) -> None:
        """Take settings that were changed at run time, and pass the limits on."""
        self.in_force = settings
        self.process.adopt(settings, self.around.scenario.input_specs)
        self._limits()

    def _limits(self) -> None:
        settings, inputs = self.in_force, self.around.scenario.inputs
        limits = Limits(
            settings.max_command_age_s, settings.lease_s, tuple((i.name, i.max_age_ms, i.rate_hz) for i in inputs),
            settings.loss_timeout_s, settings.activation_deadline_s,
        )  # fmt: skip
        for process in ("collector", "data"):
            self.send(process, limits)

    # -- ports of the core's process ----------------------------------------------------------------------------------

    def send(self, to: str, message: object) -> bool:
        """Send a datagram; permissions and gates are shown."""
        self._show(message)
        return super().send(to, message)

    def renew(self, to: str, message: object) -> bool:
        """Send a level that has not changed; gates are shown."""
        self._show(message)
        return super().renew(to, message)

    def _show(self, message: object) -> None:
        if isinstance(message, Speak) and isinstance(message.body, Permission):
            self.around.witness.permitted(message.body, message.incarnation)
        elif isinstance(message, SetGate):
            self.around.witness.gate_said(message.gate)

    def carry_out(self, command: Command) -> None:
        """Call a node or the driver."""
        if isinstance(command, Inhibit):
            self.around.driver.inhibit(command.inhibit, self, partial(self._inhibited, self.life))
        else:
            call_node(self, self.process.guard, self.nodes, command)

    def _inhibited(self, life: int, value: bool) -> None:
        if life == self.life:
            self.process.guard(InhibitAnswered(value))

    def answer(self, key: int, accepted: bool, message: str) -> None:
        """Show the answer to a switch by hand."""
        self.around.witness.answered(key, accepted, message)

    def network_status(self, sustained: int) -> None:
        """Publish nothing here."""

    def decided(self, decided: Decided) -> None:
        """Show a decision."""
        self.process.take_effects()
        self.around.witness.robot_decided(decided)

    def effects_changed(self) -> None:
        """Note which side is admitted."""
        self.process.take_effects()

    def available(self, statements: tuple[Available, ...]) -> None:
        """Show the statements about nodes with placement Cloud."""
        self.around.witness.available(statements)


class RobotPulse(PulseShell):
    """Beats only."""

    def __init__(self, around: Surroundings, host: Host, peers: dict[str, Shell]) -> None:
        super().__init__(around, host, "pulse", peers)
        self.period_s = around.scenario.settings.beat_period_s
        self.state = pulse.Pulse(UID, Site.ROBOT, self.period_s)
        self.sent: PulseSent | None = None
        self.told_sent_s = 0.0

    def boot(self) -> None:
        """Start without a permission and without a partner."""
        self.state = pulse.Pulse(UID, Site.ROBOT, self.period_s)
        self.sent, self.told_sent_s = None, 0.0
        if self.life > 1:
            self.around.link.pulse.reopen()
        self.once(0.0, self.turn)

    def take(self, message: object) -> None:
        """Take what control wants sent."""
        if isinstance(message, Speak):
            self.state = pulse.speak(self.state, message.incarnation, message.body, message.said_s)
        elif isinstance(message, Reopen):
            self.around.link.pulse.reopen()

    def beat(self) -> None:
        """Send the next beat."""
        now_s = self.host.now_s()
        self.state, beat = pulse.compose(self.state, now_s, self.host.wall_us)
        self.around.witness.beat_sent(beat)
        self.around.link.pulse.up.carry(written(beat), self.world.now)
        self.sent = PulseSent(now_s, isinstance(beat.body, Permission) and beat.body.granted)
        if now_s - self.told_sent_s > self.period_s:  # otherwise an arriving beat carries it
            self.told_sent_s = now_s
            self.send("control", self.sent)

    def hear(self, sent: Beat | str, _sent_s: float) -> None:
        """Take what arrived on the pulse session."""
        beat = read(sent)
        if beat is None:
            return
        now_s = self.host.now_s()
        self.state, newer = pulse.hear(self.state, beat, now_s)
        if newer:
            self.around.witness.cloud_beat(beat, now_s)
            self.told_sent_s = now_s
            self.answer(now_s)
            control = self.peers["control"]
            assert isinstance(control, RobotControl)
            control.post(self.name, control.beat, beat, now_s, self.host.wall_us, self.sent)
            partner = pulse.partner(self.state)
            if partner is not None:
                self.heard = Heard(partner.incarnation, partner.sent_us, partner.arrived_s)


class RobotData(DataShell):
    """Inputs out, envelopes in."""

    process: RobotDataProcess

    def __init__(self, around: Surroundings, host: Host, peers: dict[str, Shell]) -> None:
        super().__init__(around, host, "data", peers)
        self.process = RobotDataProcess(around.scenario.data_plan, self)
        self.since = {spec.name: Since() for spec in around.scenario.inputs}

    def boot(self) -> None:
        """Start anew; a new process opens a new session."""
        self.process = RobotDataProcess(self.around.scenario.data_plan, self)
        self.since = {spec.name: Since() for spec in self.around.scenario.inputs}
        if self.life > 1:
            self.around.link.data.reopen()
        self.boot_timers()

    def input(self, name: str, payload: Sensed, published_s: float) -> None:
        """Take a message of an input from the robot's sensors, with its publisher's stamp."""
        self.look_who_is_heard()
        payload.since_s = self.since[name].counts_s(self.host, payload.since_s)
        self.process.forward(name, payload, published_s=published_s)

    def cross(self, channel: str, header: bytes, payload: Any) -> bool:
        """Send over the data session."""
        session = self.around.link.data
        session.up.carry(channel, header, payload, datagram=channel == "probe")
        return session.connected

    def arrived(self, channel: str, header: bytes, payload: Any) -> None:
        """Take a message from the link, or a request of the cloud for an effect."""
        if channel == "effect":
            collector = self.peers["collector"]
            assert isinstance(collector, CollectorShell)
            collector.post(self.name, collector.cloud_effect, payload)
        else:
            super().arrived(channel, header, payload)
