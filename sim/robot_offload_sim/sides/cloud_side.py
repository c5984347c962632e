"""The cloud's three processes: the core's own classes, driven by virtual time instead of sockets and threads."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from typing import Any

from robot_offload_core.control.cloud import lease
from robot_offload_core.control.cloud.lease import Stand
from robot_offload_core.control.cloud.process import CloudControlProcess
from robot_offload_core.control.nodes.guardians import Guardian
from robot_offload_core.control.nodes.managed_nodes import Command
from robot_offload_core.data.cloud import CloudDataProcess
from robot_offload_core.fence.envelope import encode
from robot_offload_core.fence.token import Site, Token
from robot_offload_core.pulse import pulse
from robot_offload_core.words.beats import Beat, CloudReport
from robot_offload_core.words.messages import Heard, Notes, Speak
from robot_offload_core.words.veil import unveil_token
from robot_offload_sim.sides.shells import (
    EFFECT_S,
    LOOK_S,
    TYPE,
    DataShell,
    PulseShell,
    Shell,
    call_node,
    plain_nodes_seen,
    read,
    written,
)
from robot_offload_sim.world.nodes import Message, Node
from robot_offload_sim.world.ports import Payload, Sensed, Surroundings, decoded
from robot_offload_sim.world.scenario import UID
from robot_offload_sim.world.since import Since
from robot_offload_sim.world.world import Host, Process

SENT_KEPT = 60
SENT_EVERY = 7
"""Every seventh message that left is kept for the fault that makes old ones arrive again."""
NOTES_S = 1.0


class CloudSide:
    """The cloud: its host, processes and nodes."""

    def __init__(self, around: Surroundings, host: Host) -> None:
        self.around = around
        self.host = host
        peers: dict[str, Shell] = {}
        self.control = CloudControl(around, host, peers)
        self.pulse = CloudPulse(around, host, peers)
        self.data = CloudData(around, host, peers)
        self.processes: tuple[Process, ...] = (self.control, self.pulse, self.data)
        scenario = around.scenario
        self.nodes = {
            spec.name: Node(around.world, host, spec, scenario.cloud_replicas[spec.name], self._publish)
            for spec in scenario.cloud_nodes
        }
        for node in self.nodes.values():
            node.transition_s = scenario.transition_s
        self.control.nodes = self.nodes
        around.link.pulse.up.target = self.pulse, self.pulse.hear
        around.link.data.up.target = self.data, self.data.arrived

    def _publish(self, name: str, index: int, message: Message) -> None:
        self.data.post(name, self.data.output, index, message, self.host.system_s())

    def start(self) -> None:
        """Start everything, the user's nodes first."""
        for process in (*self.nodes.values(), self.data, self.pulse):
            process.start()
        self.around.world.after(self.around.scenario.late_s[1], self.control.start)


class WatchedControl(CloudControlProcess):
    """The core's class, with every event of its machine counted for coverage."""

    around: Surroundings

    def step(self, event: lease.Event) -> None:
        """Count the event, then take it."""
        self.around.coverage.cloud(self.cloud, event, self.ports.now_s())
        known = self.cloud.robot
        super().step(event)
        if known and not self.cloud.robot:
            self.around.entered("cloud Alone")


class CloudControl(Shell):
    """The cloud's control in virtual time. `leaving`: the announced end of its pods; "" for none."""

    def __init__(self, around: Surroundings, host: Host, peers: dict[str, Shell]) -> None:
        super().__init__(around, host, "control", peers)
        self.nodes: dict[str, Node] = {}
        self.leaving = ""
        self.process = self._made("0" * 32)

    @property
    def cloud(self) -> lease.Cloud:
        """Return the state of the lease machine."""
        return self.process.cloud

    @property
    def guardian(self) -> Guardian:
        """Return the state of the guardian."""
        return self.process.guardian

    def _made(self, incarnation: str) -> WatchedControl:
        scenario = self.around.scenario
        process = WatchedControl(
            scenario.cloud_settings,
            scenario.cloud_nodes,
            self,
            incarnation,
            outputs=scenario.outputs,
            publishers=scenario.publishers,
            has_relay=scenario.relay is not None,
            has_state=bool(scenario.states),
            shape=scenario.shape(Site.CLOUD),
        )
        process.around = self.around
        return process

    def boot(self) -> None:
        """Start a new incarnation that knows nothing."""
        incarnation = f"{self.world.dice.getrandbits(128):032x}"
        self.leaving = ""
        self.process = self._made(incarnation)
        self.around.witness.cloud_started(incarnation)
        self.around.controlled(self.process)
        self.every(self.around.scenario.tick_s, self.process.turn, first_s=0.0)
        self.every(NOTES_S, self._notes)
        self.every(LOOK_S, lambda: self.process.guard(plain_nodes_seen(self.nodes)), first_s=0.1)

    def take(self, message: object) -> None:
        """Take a datagram."""
        if not isinstance(message, Notes):
            self.process.handle(message)

    def beat(self, beat: Beat, arrived_s: float, wall_us: int, sent_true_s: float) -> None:
        """Take a beat of a robot."""
        self.around.witness.grant_delivered(beat, sent_true_s)
        self.process.arrived(beat, arrived_s, wall_us)

    def announce(self, leaving: str) -> None:
        """Announce the end of these pods to the robot."""
        self.leaving = leaving
        self._notes()

    def _notes(self) -> None:
        self.send("data", Notes(self.process.incarnation, self.leaving))

    # -- ports of the core's process ----------------------------------------------------------------------------------

    def carry_out(self, command: Command) -> None:
        """Call a node."""
        call_node(self, self.process.guard, self.nodes, command)

    def answer(self, key: int, accepted: bool, message: str) -> None:
        """Show the answer to a switch by hand."""
        self.around.witness.answered(key, accepted, message)

    def network_status(self, sustained: int) -> None:
        """Publish nothing here."""

    def decided(self, reason: Stand, message: str) -> None:
        """Show a decision."""
        self.world.note("cloud", reason.value, message)
        self.around.entered("cloud " + reason.value)


class CloudPulse(PulseShell):
    """Beats only. `bare` counts the faults that strip them of all content."""

    def __init__(self, around: Surroundings, host: Host, peers: dict[str, Shell]) -> None:
        super().__init__(around, host, "pulse", peers)
        self.period_s = around.scenario.settings.beat_period_s
        self.state = pulse.Pulse(UID, Site.CLOUD, self.period_s)
        self.last: Beat | None = None
        self.bare = 0

    def boot(self) -> None:
        """Start without a report and without a partner."""
        self.state = pulse.Pulse(UID, Site.CLOUD, self.period_s)
        if self.life > 1:
            self.around.link.pulse.reopen()
        self.once(0.0, self.turn)

    def take(self, message: object) -> None:
        """Take what control wants sent."""
        if isinstance(message, Speak) and isinstance(message.body, CloudReport):
            self.state = pulse.speak(self.state, message.incarnation, message.body, message.said_s)

    def beat(self) -> None:
        """Send the next beat."""
        self.state, beat = pulse.compose(self.state, self.host.now_s(), self.host.wall_us)
        self.last = beat
        if self.bare:
            beat = replace(beat, echo=None, body=None)
        self.around.link.pulse.down.carry(written(beat), self.world.now)

    def hear(self, sent: Beat | str, sent_true_s: float) -> None:
        """Take what arrived on the pulse session."""
        beat = read(sent)
        if beat is None:
            return
        now_s = self.host.now_s()
        self.state, newer = pulse.hear(self.state, beat, now_s)
        if newer:
            self.answer(now_s)
            control = self.peers["control"]
            assert isinstance(control, CloudControl)
            control.post(self.name, control.beat, beat, now_s, self.host.wall_us, sent_true_s)
            partner = pulse.partner(self.state)
            if partner is not None:
                self.heard = Heard(partner.incarnation, partner.sent_us, partner.arrived_s)


class CloudData(DataShell):
    """Receives inputs; the egress reads the lease for each message at the moment of sending.

    Attributes:
        sent: some of the messages that have left, for the fault that makes old messages arrive again.
        datagrams: channels whose lost messages are not sent again.
        since: from when the age of each output's messages counts.
    """

    process: CloudDataProcess

    def __init__(self, around: Surroundings, host: Host, peers: dict[str, Shell]) -> None:
        super().__init__(around, host, "data", peers)
        self.process = CloudDataProcess(around.scenario.cloud_plan, self)
        self.sent: deque[tuple[str, bytes, Payload]] = deque(maxlen=SENT_KEPT)
        self.count = 0
        self.input_types: dict[str, str] = {}
        self.since = [Since() for _ in around.scenario.outputs]
        scenario = around.scenario
        self.datagrams = {"probe", *(f"out/{scenario.outputs[i].name}" for i in scenario.best_effort)}

    def boot(self) -> None:
        """Start over: nothing may leave; a new process opens a new session."""
        self.process = CloudDataProcess(self.around.scenario.cloud_plan, self)
        self.since = [Since() for _ in self.around.scenario.outputs]
        if self.life > 1:
            self.around.link.data.reopen()
        self.boot_timers()
        self.every(EFFECT_S, self._effect)

    @property
    def token(self) -> Token | None:
        """Return the token under which messages may leave; None when none may."""
        return self.process.egress.egress.token

    def output(self, index: int, message: Message, published_s: float) -> None:
        """Take what a replica has published, with its publisher's stamp."""
        self.look_who_is_heard()
        self.process.leave(
            index, Payload(Site.CLOUD, message, b"", self.since[index].counts_s(self.host, message.born_s)), published_s
        )

    def cross(self, channel: str, header: bytes, payload: Any) -> bool:
        """Send over the data session, and show it to the witness."""
        session = self.around.link.data
        if isinstance(payload, Payload):
            said = decoded(header)
            meant = replace(said, token=unveil_token(said.token, self.process.egress.robot))
            self.around.witness.left_cloud(meant.token)
            payload = payload._replace(header=encode(meant))
            self.count += 1
            if self.count % SENT_EVERY == 1:
                self.sent.append((channel, header, payload))
        session.down.carry(channel, header, payload, datagram=channel in self.datagrams)
        return session.connected

    def _effect(self) -> None:
        egress = self.process.egress.egress
        if egress.token is not None and self.host.now_s() < egress.lease_end_s:
            self.around.witness.left_cloud(egress.token)
            self.around.link.data.down.carry("effect", b"", egress.token)

    def publish_output(self, index: int, payload: Payload) -> None:
        """Publish to the consumers in the cloud."""
        self.around.witness.heard_in_cloud(index, payload)
        if index in self.process.loops:  # we also listen on the public topic of a shared output
            self.post(self.name, self.process.hear_others, index, payload)

    def fill(self, index: int, payload: Payload) -> None:
        """Publish on the private topic: the replica receives it, and so do we."""
        self.around.witness.filled(Site.CLOUD, index, payload)
        self.post(self.name, self.process.leave, index, payload)

    def input_type(self, name: str) -> str:
        """Return the type under which an input is published: the robot's, unless a fault changes it."""
        return self.input_types.get(name, TYPE)

    def publish_input(self, name: str, payload: Sensed) -> bool:
        """Publish to the replicas."""
        self.around.witness.input_heard(name, self.world.now - payload.since_s)
        return True
