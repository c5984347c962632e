"""What the cloud's control process does around the lease: levels out, requests by hand to the robot."""

from __future__ import annotations

from typing import Protocol

from robot_offload_core.control.cloud import lease
from robot_offload_core.control.cloud.lease import Stand
from robot_offload_core.control.nodes import guardians
from robot_offload_core.control.nodes.rest import Rest
from robot_offload_core.control.process import ControlPorts, ControlProcess
from robot_offload_core.fence.token import Site
from robot_offload_core.link import links
from robot_offload_core.words.beats import PREVIOUS, Beat
from robot_offload_core.words.events import Acting, CloudData, Machine, SetEgress, Tick, Witness, assert_never
from robot_offload_core.words.messages import DataStatus, Egress, PulseSent, RelayStatus, Speak
from robot_offload_core.words.replace import replace
from robot_offload_core.words.settings import NodeSpec, OutputSpec, Settings

REQUEST_LIFE_S = 2.0
"""How long a switch requested here is offered to the robot before it is refused."""


class CloudControlPorts(ControlPorts, Protocol):
    """What else the shell does for the cloud's control process."""

    def decided(self, reason: Stand, message: str) -> None:
        """Log a decision."""


class CloudControlProcess(ControlProcess):
    """The cloud's control process.

    Attributes:
        cloud: state of the lease machine.
        link: health of the link to the robot served.
        complete: the latched inputs equal the robot's.
        data_s: when the data process last reported.
        data_status: its newest report with details.
        relay_status: newest report of the relay.
        rest: whether this side's nodes stay Active for their goals.
        request: the switch by hand that is offered to the robot; "" for none.
        veils: the robot served understands messages that name it by the hash of its incarnation.
    """

    def __init__(
        self, settings: Settings, nodes: tuple[NodeSpec, ...], ports: CloudControlPorts, incarnation: str,
        has_relay: bool = False, outputs: tuple[OutputSpec, ...] = (), publishers: tuple[str, ...] = (),
        has_state: bool = False, *, shape: str = "",
    ) -> None:  # fmt: skip
        """Begin without a robot.

        `publishers`: node of each of `outputs`, "" if unknown. `has_relay`: services or actions are declared.
        `has_state`: state is declared. `shape`: of our configuration.
        """
        guard = guardians.start(nodes, settings.activation_deadline_s)
        super().__init__(ports, incarnation, guard, outputs, publishers)
        self.ports: CloudControlPorts = ports
        self.settings = settings
        self.shape = shape
        self.veils = True
        self.has_relay = has_relay
        self.hands_over = has_relay or has_state
        self.rest = Rest(Site.CLOUD, settings.cancel_deadline_s)
        self.relay_status: RelayStatus | None = None
        self.cloud = lease.start(incarnation, settings)
        self.link = links.Link()
        self.data_s = ports.now_s()
        self.data_status: DataStatus | None = None
        self.cloud_data: CloudData | None = None
        self.complete = False
        self.request = ""
        self.requests = 0
        self.request_key = 0
        self.request_until_s = 0.0
        self.told: tuple[object, ...] = ()
        self.told_s = 0.0

    def watched_by(self, witness: Witness) -> None:
        """Let `witness` see every step from now on."""
        super().watched_by(witness)
        witness.restated(Machine.LEASE, self.ports.now_s(), self.cloud)

    def ask(self, site: Site, key: int) -> None:
        """Request a switch by hand from the robot, which decides; the request travels with our probes."""
        self.requests += 1
        self.request = f"{site.value}:{self.incarnation[:8]}.{self.requests}"
        self.request_until_s = self.ports.now_s() + REQUEST_LIFE_S
        self.request_key = key

    def arrived(self, beat: Beat, arrived_s: float, wall_us: int, sent: PulseSent | None = None) -> None:
        """Take a beat of a robot; `sent` is not used on this side."""
        del sent
        self.step(lease.RobotBeat(beat, arrived_s))
        if beat.incarnation == self.cloud.robot:
            self.veils = beat.version != PREVIOUS
            self.link = links.hear(self.link, beat, self.incarnation, arrived_s, wall_us)

    def handle(self, message: object) -> None:
        """Take the reports of data and relay."""
        if isinstance(message, RelayStatus):
            self.relay_status = message
            self.rest.take(message, self.ports.now_s())
            self.executing, self.relay_s = message.executing, self.ports.now_s()
            self._note_while()
        if not isinstance(message, DataStatus) or message.cloud_data is None:
            return
        self.data_s = self.ports.now_s()
        self.note_flowing(message.flowing)
        if message.counters:
            self.data_status = message
        if message.complete is not self.complete:
            self.complete = message.complete
        request, _, answer = message.word.partition("|")
        if request and request == self.request:
            accepted, _, text = answer.partition("|")
            self.ports.answer(self.request_key, accepted == "1", text)
            self.request = ""
        self.occasions, self.cloud_data = message.occasions, message.cloud_data
        self.step(replace(message.cloud_data, rated=self._bits()))

    def _note_while(self) -> None:
        """Report at once if other outputs must publish here now."""
        if self.cloud_data is not None and self._bits() != self.cloud.rated:
            self.step(replace(self.cloud_data, rated=self._bits()))

    def _bits(self) -> int:
        return sum(1 << index for index in self.holding())

    def tick(self) -> None:
        """Tick the lease machine."""
        self.check_ready()
        self._note_while()
        if self._able() is not self.cloud.ready:
            self.step(lease.CloudNodes(self._able()))
        self.step(Tick())
        if self.request and self.ports.now_s() >= self.request_until_s:
            self.ports.answer(self.request_key, False, "Refused (RobotUnheard): the robot did not answer")
            self.request = ""

    def ready_changed(self, ready: bool) -> None:
        """Take the changed readiness of the CORE nodes."""
        del ready
        self.step(lease.CloudNodes(self._able()))

    def _able(self) -> bool:
        """Return whether the CORE nodes are Active and had the robot's latched inputs before they began to act.

        A latched input that changes later does not end a stay: its new value is on the way to the replicas.
        """
        acting = lease.holds_lease(self.cloud, self.ports.now_s()) and self.cloud.ready
        return self.is_ready() and (self.complete or acting)

    def step(self, event: lease.Event) -> None:
        """Step the lease and carry out its commands."""
        now_s, before = self.ports.now_s(), self.cloud
        self.cloud, commands = self.watched(Machine.LEASE, lease.step, before, event, now_s)
        if self.hands_over and lease.called_off(before, self.cloud):
            self.rest.settle(now_s + self.settings.settle_for_s)
        egress, _, said = commands[:3]
        assert isinstance(egress, SetEgress)
        assert isinstance(said, lease.SetReport)
        report = replace(said.report, shape=self.shape)
        # Ages change with every step and are worth sending once a beat; everything else at once.
        level = (
            report.serves, report.epoch, report.acting, report.ready, report.refused, report.rated, egress, self.request
        )  # fmt: skip
        if level != self.told or now_s - self.told_s >= self.settings.beat_period_s:
            self.told, self.told_s = level, now_s
            self.ports.send("pulse", Speak(self.incarnation, report, now_s))
            words = (self.incarnation, self.cloud.robot, egress, self.node_states(), self.request, self.veils)
            for process in ("data", "relay") if self.has_relay else ("data",):
                self.ports.send(process, Egress(*words))
        for command in commands:
            match command:
                case Acting():
                    acting = self.rest.keeps_active(command.acting, now_s) or command.acting
                    if acting is not self.guardian.acting:
                        self.guard(replace(command, acting=acting))
                case lease.StandChanged():
                    self.ports.decided(command.reason, command.message)
                case lease.SetReport() | SetEgress():
                    pass  # levels, see above
                case _:
                    assert_never(command)

    def health(self) -> links.Health | None:
        """Return the health of the link to the robot served; None if no robot is served."""
        return links.health(self.link, self.ports.now_s()) if self.cloud.robot else None

    def sustained(self) -> int:
        """Return 1 if a robot is heard, else 0."""
        alive = self.ports.now_s() - self.cloud.robot_s <= self.settings.loss_timeout_s
        return int(bool(self.cloud.robot) and alive)
