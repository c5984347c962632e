"""The cloud's three processes around the real core functions: control, pulse, data with the egress gate."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from typing import TYPE_CHECKING

from robot_offload_core import guardians, lease, pulse
from robot_offload_core.beats import Beat, CloudReport
from robot_offload_core.envelope import Envelope
from robot_offload_core.events import Acting, Tick
from robot_offload_core.token import Site, Token
from robot_offload_lab.simulate.nodes import Message, Node
from robot_offload_lab.simulate.robot_side import EFFECT_S, PROBE_S, call_node, read, written
from robot_offload_lab.simulate.scenario import UID
from robot_offload_lab.simulate.world import Host, Process

if TYPE_CHECKING:
    from robot_offload_lab.simulate.chunk import Chunk


SENT_KEPT = 60
SENT_EVERY = 7
"""Every seventh message that left is kept for the fault that lets old ones arrive again."""


class CloudSide:
    """The cloud: its host, processes and nodes."""

    def __init__(self, run: Chunk, host: Host) -> None:
        self.host = host
        self.control = CloudControl(run, host)
        self.pulse = CloudPulse(run, host)
        self.data = CloudData(run, host)
        sources, period_s = run.scenario.sources, run.scenario.settings.cloud_period_s
        self.nodes = {
            spec.name: Node(run.world, host, spec, period_s, sources.get(spec.name), self._publish)
            for spec in run.scenario.cloud_nodes
        }
        for node in self.nodes.values():
            node.transition_s = run.scenario.transition_s
        self.processes = (self.control, self.pulse, self.data)

    def _publish(self, name: str, index: int, message: Message) -> None:
        self.data.send(name, self.data.output, index, message)

    def start(self) -> None:
        """Starts everything, the user's nodes first."""
        for process in (*self.nodes.values(), self.data, self.pulse):
            process.start()
        self.control.world.after(self.control.run.scenario.late_s[1], self.control.start)


class CloudControl(Process):
    """Lease and guardian: drains what has arrived, ticks every 10 ms."""

    def __init__(self, run: Chunk, host: Host) -> None:
        super().__init__(run.world, host, "cloud/control")
        self.run = run
        self.cloud = lease.Cloud("0" * 32, run.scenario.settings)
        self.guardian = guardians.start((), 0.0)
        self.ready = False
        self._egress: tuple[Token | None, float] = (None, 0.0)
        self._egress_s = 0.0

    @property
    def incarnation(self) -> str:
        """Of the present life."""
        return self.cloud.incarnation

    def boot(self) -> None:
        """A new incarnation that knows nothing."""
        scenario = self.run.scenario
        incarnation = f"{self.world.dice.getrandbits(128):032x}"
        self.cloud = lease.Cloud(incarnation, scenario.settings)
        self.guardian = guardians.start(scenario.cloud_nodes, scenario.settings.activation_deadline_s)
        self.ready = False
        self.run.observer.cloud_started(incarnation)
        self.every(scenario.tick_s, self._tick, first_s=0.0)

    def _tick(self) -> None:
        self.guard(Tick())
        self.step(Tick())

    def robot_beat(self, beat: Beat, arrived_s: float, sent_true_s: float) -> None:
        """The pulse process hands over a robot's beat."""
        self.run.observer.grant_delivered(beat, sent_true_s)
        self.step(lease.RobotBeat(beat, arrived_s))

    def step(self, event: lease.Event) -> None:
        """One event through the lease machine."""
        now_s = self.host.now_s()
        self.run.coverage.cloud(self.cloud, event, now_s)
        known = self.cloud.robot
        self.cloud, commands = lease.step(self.cloud, event, now_s)
        run = self.run
        if known and not self.cloud.robot:
            run.faults.entered("cloud Alone")
        for command in commands:
            if isinstance(command, Acting):
                if command.acting is not self.guardian.acting:
                    self.guard(Acting(command.acting))
            elif isinstance(command, lease.SetEgress):
                self._set_egress(command.token, command.lease_end_s, now_s)
            elif isinstance(command, lease.SetReport):
                run.cloud.pulse.send(self.name, run.cloud.pulse.speak, self.incarnation, command.report, now_s)
            else:
                self.world.note("cloud", command.reason, command.message)
                run.faults.entered("cloud " + command.reason)

    def _set_egress(self, token: Token | None, end_s: float, now_s: float) -> None:
        if (token, end_s) == self._egress and now_s - self._egress_s < self.run.scenario.settings.beat_period_s:
            return
        self._egress, self._egress_s = (token, end_s), now_s
        self.run.cloud.data.send(self.name, self.run.cloud.data.set_egress, token, end_s)

    def guard(self, event: guardians.Event) -> None:
        """One event through the guardian; a change of readiness goes to the lease machine."""
        self.guardian, commands = guardians.step(self.guardian, event, self.host.now_s())
        for command in commands:
            call_node(self, self.run.cloud.nodes, command)
        ready = guardians.is_ready(self.guardian)
        if ready is not self.ready:
            self.ready = ready
            self.step(lease.CloudNodes(ready))


class CloudPulse(Process):
    """Beats only. `bare` counts the faults that strip them of all content."""

    def __init__(self, run: Chunk, host: Host) -> None:
        super().__init__(run.world, host, "cloud/pulse")
        self.run = run
        self.state = pulse.Pulse(UID, Site.CLOUD, run.scenario.settings.beat_period_s)
        self.last: Beat | None = None
        self.bare = 0

    def boot(self) -> None:
        """Knows no report and has heard nobody."""
        period_s = self.run.scenario.settings.beat_period_s
        self.state = pulse.Pulse(UID, Site.CLOUD, period_s)
        if self.life > 1:
            self.run.link.pulse.reopen()
        self.every(period_s, self._beat, first_s=0.0)

    def speak(self, incarnation: str, report: CloudReport, said_s: float) -> None:
        """Control has renewed its report."""
        self.state = pulse.speak(self.state, incarnation, report, said_s)

    def _beat(self) -> None:
        self.state, beat = pulse.compose(self.state, self.host.now_s(), self.host.wall_us)
        self.last = beat
        if self.bare:
            beat = replace(beat, echo=None, body=None)
        target = self.run.robot.pulse
        self.run.link.pulse.down.carry(target.deliver, target.hear, written(beat), self.world.now)

    def hear(self, sent: Beat | str, sent_true_s: float) -> None:
        """Something arrived on the pulse session."""
        beat = read(sent)
        if beat is None:
            return
        now_s = self.host.now_s()
        self.state, newer = pulse.hear(self.state, beat, now_s)
        if newer:
            control, data = self.run.cloud.control, self.run.cloud.data
            control.send(self.name, control.robot_beat, beat, now_s, sent_true_s)
            data.send(self.name, data.beat_heard, beat.incarnation, beat.sent_us)


class CloudData(Process):
    """Inputs in; the egress gate checks the lease for each message at the moment of sending."""

    def __init__(self, run: Chunk, host: Host) -> None:
        super().__init__(run.world, host, "cloud/data")
        self.run = run
        self.token: Token | None = None
        self.end_s = 0.0
        self.heard_us: dict[str, int] = {}
        self.probe_s: float | None = None
        self.inputs: list[tuple[float, float] | None] = []
        self.sequences: list[int] = []
        self.sent: deque[tuple[int, Envelope, Message, float]] = deque(maxlen=SENT_KEPT)

    def boot(self) -> None:
        """Nothing may leave."""
        self.token, self.end_s = None, 0.0
        self.heard_us = {}
        self.probe_s = None
        self.inputs = [None] * len(self.run.scenario.inputs)
        self.sequences = [0] * len(self.run.scenario.outputs)
        if self.life > 1:
            self.run.link.data.reopen()
        self.every(PROBE_S, self._probe)
        self.every(self.run.scenario.report_s, self._report)
        self.every(EFFECT_S, self._effect)

    def set_egress(self, token: Token | None, end_s: float) -> None:
        """Control says what may leave, and until when."""
        if token != self.token:
            self.sequences = [0] * len(self.sequences)
        self.token, self.end_s = token, end_s

    def beat_heard(self, incarnation: str, sent_us: int) -> None:
        """The pulse process heard a robot's beat: the echo reference of what we send to that robot."""
        self.heard_us[incarnation] = sent_us

    def may_leave(self) -> bool:
        """The gate, for one message, now."""
        return self.token is not None and self.host.now_s() < self.end_s

    def output(self, index: int, message: Message) -> None:
        """A replica has published."""
        if not self.may_leave():
            return
        token = self.token
        assert token is not None
        self.sequences[index] += 1
        envelope = Envelope(token, self.sequences[index], self.heard_us.get(token.robot, 0))
        self.run.observer.left_cloud(token)
        target = self.run.robot.data
        self.run.link.data.down.carry(target.deliver, target.envelope, index, envelope, message, self.world.now)
        if envelope.sequence % SENT_EVERY == 1:
            self.sent.append((index, envelope, message, self.world.now))

    def _effect(self) -> None:
        if self.may_leave() and self.token is not None:
            self.run.observer.left_cloud(self.token)
            target = self.run.robot.data
            self.run.link.data.down.carry(target.deliver, target.effect, self.token)

    def _probe(self) -> None:
        target = self.run.robot.data
        self.run.link.data.down.carry(target.deliver, target.probe, self.run.cloud.control.incarnation)

    def probe(self, _robot: str) -> None:
        """A probe of the robot's data process."""
        self.probe_s = self.host.now_s()

    def input(self, index: int, envelope: Envelope) -> None:
        """A message of an input; its age is bounded at arrival."""
        now_s = self.host.now_s()
        self.inputs[index] = (envelope.age_s(now_s), now_s)

    def _report(self) -> None:
        now_s = self.host.now_s()
        age_s = None if self.probe_s is None else now_s - self.probe_s
        ages = tuple(
            None if held is None else held[0] + now_s - held[1]
            for held, spec in zip(self.inputs, self.run.scenario.inputs, strict=True)
            if spec.max_age_s > 0
        )
        control = self.run.cloud.control
        control.send(self.name, control.step, lease.CloudData(age_s, ages))
