"""What the robot's control process does around the placement machine: levels out, reports in, the cloud's requests."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

from robot_offload_core.control.nodes import guardians, managed_nodes
from robot_offload_core.control.nodes.rest import Rest
from robot_offload_core.control.process import ControlPorts, ControlProcess
from robot_offload_core.control.robot import changeovers, health, placement, readiness, switcher
from robot_offload_core.control.robot.availability import Available, available
from robot_offload_core.control.robot.limits import DATA_TIMEOUT_S
from robot_offload_core.control.robot.placement import CloudBeat, Robot, Wish
from robot_offload_core.control.robot.settling import meanwhile
from robot_offload_core.fence import grant
from robot_offload_core.fence.token import Site
from robot_offload_core.words import slow_outputs
from robot_offload_core.words.beats import Beat, unveil
from robot_offload_core.words.decided import Decided, Phase
from robot_offload_core.words.events import Acting, Machine, StateReported, Tick, Witness, assert_never
from robot_offload_core.words.gates import Gate
from robot_offload_core.words.lifecycle import State
from robot_offload_core.words.messages import (
    CollectorStatus,
    DataStatus,
    Orders,
    PulseSent,
    RelayOrders,
    RelayStatus,
    Reopen,
    SetGate,
    Speak,
)
from robot_offload_core.words.reasons import Reason
from robot_offload_core.words.replace import replace
from robot_offload_core.words.settings import InputSpec, NodeSpec, OutputSpec, Settings

LEVELS_PER_LEASE = 5
UNSEEN = State.UNKNOWN.value
REPLICA_GRACE_S = 3.0
"""How long a replica may take to appear before it is reported missing."""
UNREAD_MOST_S = 0.045
"""Longest time between two Ticks, apart from a turn: below what counts as a stall."""
STEPPED_MOST_S = 0.015
"""A Tick is left out only after a step at most this old: with a turn in 30 ms the gap stays below a stall (50 ms)."""
DEADLINE_MARGIN_S = 0.0005
"""Added to a deadline, so that one turn finds it passed."""
VETOES = {
    reason.value: reason for reason in (
        Reason.SECOND_PUBLISHER, Reason.UNDECLARED_PUBLISHER, Reason.TYPES_DIFFER, Reason.DUPLICATE_AGENT,
        Reason.SECOND_LIFECYCLE_MANAGER, Reason.REPLICA_PARAMETERS_DIFFER, Reason.TWO_REPLICAS, Reason.SECOND_SESSION,
    )
}  # fmt: skip
"""Problems found by other processes that forbid the cloud or stop the policy."""
FROM_CLOUD = 0
"""Key of a switch by hand requested in the cloud."""


class RobotControlPorts(ControlPorts, Protocol):
    """What else the shell does for the robot's control process."""

    def decided(self, decided: Decided) -> None:
        """Log a decision and publish the placement."""

    def effects_changed(self) -> None:
        """Publish the placement again, because another side's effects are admitted now."""

    def available(self, statements: tuple[Available, ...]) -> None:
        """Publish which nodes with placement Cloud have results that reach the robot."""


@dataclass(frozen=True)
class RobotPlan:
    """Configuration of the robot's control.

    Attributes:
        settings: of the robot's file.
        asked: settings in force, which may have been changed since.
        inputs: topics to the cloud.
        nodes: nodes managed here.
        has_driver: there is an inhibit service.
        pin: set by a person on the robot.
        outputs: the collected outputs.
        publishers: the node that publishes each of them; "" if unknown.
        strict: a second or undeclared publisher stops the driver.
        has_relay: services or actions are declared.
        has_state: state is declared.
        shape: of the configuration (shape.py); "" if unknown.
    """

    settings: Settings
    asked: Settings
    inputs: tuple[InputSpec, ...]
    nodes: tuple[NodeSpec, ...]
    has_driver: bool = False
    pin: Wish | None = None
    outputs: tuple[OutputSpec, ...] = ()
    publishers: tuple[str, ...] = ()
    strict: bool = False
    has_relay: bool = False
    has_state: bool = False
    shape: str = ""


class RobotControlProcess(ControlProcess):
    """The robot's control process.

    Attributes:
        robot: state of the placement machine.
        data_status, collector_status: newest reports with details.
        replicas: (node, state) in the cloud.
        levels: last message to each process, and when it was sent.
        relay_status: newest report of the relay.
        asked_in_cloud, cloud_answer: newest request from the cloud, and the answer, `0 or 1|message`.
        rest: whether this side's nodes stay Active for their goals.
        left: (cloud, its last announced end) that was obeyed.
        effects: the side whose effects were admitted at the last look.
        refused_words: number of invalid requests from the cloud.
        heard: the newest event was a beat of our cloud.
        stated: last published availability of the nodes with placement Cloud.
    """

    def __init__(self, plan: RobotPlan, ports: RobotControlPorts, incarnation: str, started_us: int) -> None:
        guard = guardians.start(plan.nodes, plan.asked.activation_deadline_s, plan.has_driver)
        super().__init__(ports, incarnation, guard, plan.outputs, plan.publishers)
        self.ports: RobotControlPorts = ports
        started_s = started_us / 1e6
        # Until the cloud has stopped for sure the longest lease that an earlier process may have granted counts.
        settings = meanwhile(plan.settings, plan.asked)
        self.robot = Robot(
            grant.start(incarnation, started_s, changeovers.stopped_s(settings)), started_us, settings, plan.inputs,
            since_s=started_s, charged_s=started_s, pin=plan.pin, asked=plan.asked,
            outputs=plan.outputs, slow=slow_outputs.start(plan.outputs), shape=plan.shape,
            handing=placement.Handing(served=plan.has_relay, kept=plan.has_state),
        )  # fmt: skip
        self.settings = plan.asked
        self.strict = plan.strict
        self.data_status: DataStatus | None = None
        self.collector_status: CollectorStatus | None = None
        self.levels: dict[str, tuple[Gate | Orders | RelayOrders, float]] = {}
        self.has_relay = plan.has_relay
        self.rest = Rest(Site.ROBOT, plan.asked.cancel_deadline_s)
        self.relay_status: RelayStatus | None = None
        self.replicas: dict[str, str] = {}
        self.complete_s = self.data_s = started_s
        self.effects: Site | None = None
        self.asked_in_cloud = ""
        self.cloud_answer = ""
        self.left = ("", "")
        self.refused_words = 0
        self.heard = False
        self.stated: tuple[Available, ...] | None = None

    def watched_by(self, witness: Witness) -> None:
        """Let `witness` see every step from now on."""
        super().watched_by(witness)
        witness.restated(Machine.PLACEMENT, self.ports.now_s(), self.robot)

    # -- events in ----------------------------------------------------------------------------------------------------

    def arrived(self, beat: Beat, arrived_s: float, wall_us: int, sent: PulseSent | None = None) -> None:
        """Take a beat of the cloud, and our own newest beat."""
        self.step(CloudBeat(unveil(beat, self.incarnation), arrived_s, wall_us, sent))
        self.heard = self.robot.link.heard_s == arrived_s

    def handle(self, message: object) -> None:
        """Take reports of pulse, collector, relay and data."""
        if isinstance(message, PulseSent):
            self.step(message)
        elif isinstance(message, CollectorStatus):
            if message.counters:
                self.collector_status = message
                self.veto("collector", message.problems)
            self.step(placement.GateReported(message.report))
            self.note_flowing(message.report.robot_flowing)
        elif isinstance(message, RelayStatus):
            self._relay_reported(message)
        elif isinstance(message, DataStatus) and message.report is not None:
            if message.counters or message.replicas:
                self.data_status = message
            if message.counters:
                self.veto("data", message.problems)
            self.occasions, self.data_s = message.occasions, self.ports.now_s()
            self._note_while()
            if message.replicas:
                self.replicas = dict(message.replicas)
            self.step(message.report)
            self._states_reported(message.states)
            self._ask_for_cloud(message.word)

    def _states_reported(self, states: tuple[StateReported, ...]) -> None:
        """Take the reports of what each side lacks of the other side's state."""
        for reported in states if self.robot.handing.kept else ():
            if reported not in self.robot.handing.states:
                self.step(reported)

    def _relay_reported(self, status: RelayStatus) -> None:
        """Take the relay's report: what a change waits for, and whether this side's nodes may be deactivated."""
        self.relay_status = status
        self.executing, self.relay_s = status.executing, self.ports.now_s()
        self._note_while()
        self.rest.take(status, self.ports.now_s())
        reported = placement.RelayReported(
            status.candidate, status.pending, status.hold, status.hold_for_s, status.unfit
        )
        if reported != self.robot.handing.report:
            self.step(reported)

    def _note_while(self) -> None:
        """Update which outputs must publish on the robot now."""
        if self.ports.now_s() - self.data_s > DATA_TIMEOUT_S:
            self.occasions = ()
        holding = self.holding()
        if holding != self.robot.robot_while:
            self.step(placement.WhileReported(holding))

    def veto(self, source: str, problems: Iterable[tuple[str, str]]) -> None:
        """Take the problems, (reason, message), of one source; those in VETOES reach the machine."""
        vetoes = tuple(
            placement.Veto(
                VETOES[reason],
                message,
                stops=self.strict and VETOES[reason].forbids,
                of_robot=source == "collector" and reason == Reason.TWO_REPLICAS,
            )
            for reason, message in problems
            if reason in VETOES and (self.strict or reason != Reason.UNDECLARED_PUBLISHER)
        )
        level = placement.Vetoed(source, vetoes)
        if level != next((v for v in self.robot.vetoes if v.source == source), placement.Vetoed(source)):
            self.step(level)

    def adopt(self, settings: Settings, inputs: tuple[InputSpec, ...]) -> None:
        """Take settings that were changed at run time."""
        self.settings = settings
        self.guardian = replace(self.guardian, grace_s=settings.activation_deadline_s)
        if self.witness is not None:
            self.witness.restated(Machine.GUARDIAN, self.ports.now_s(), self.guardian)
        self.step(placement.SetSettings(settings, inputs))

    def announce_leaving(self, leaving: str, until_s: float) -> bool:
        """Take the present cloud's announcement of its end (`leaving`, "" for none); return whether it was new."""
        cloud = self.robot.link.peer
        if not leaving or (cloud, leaving) == self.left:
            return False
        self.left = cloud, leaving
        self.step(placement.CloudLeaving(cloud, until_s))
        return True

    def _ask_for_cloud(self, word: str) -> None:
        """Carry out a switch by hand requested in the cloud, each request once."""
        if not word or word == self.asked_in_cloud:
            return
        self.asked_in_cloud = word
        site, _, _ = word.partition(":")
        if site in (Site.ROBOT.value, Site.CLOUD.value):
            self.step(placement.SwitchByHand(Site(site), FROM_CLOUD))
        else:
            self.refused_words += 1
            self.cloud_answer = "0|Refused (NotUnderstood): the robot's agent does not know this request"

    def tick(self) -> None:
        """Tick the placement machine."""
        self.check_ready()
        self._note_while()
        if not self._has_judged():
            self.step(Tick())
        if switcher.effects_site(self.robot, self.ports.now_s()) is not self.effects:
            self.ports.effects_changed()
        self._state()

    def _has_judged(self) -> bool:
        """Return whether a beat of our cloud was just processed; it checks the same limits as a Tick.

        Silence is then judged as of that beat. Other events, such as foreign beats, do not replace a Tick.
        """
        heard, self.heard = self.heard, False
        read_s, stepped_s, now_s = self.robot.stalls.read_s, self.robot.stalls.stepped_s, self.ports.now_s()
        read = read_s is not None and now_s - read_s < UNREAD_MOST_S
        return heard and read and stepped_s is not None and now_s - stepped_s < STEPPED_MOST_S

    def _state(self) -> None:
        """Publish the availability of the nodes with placement Cloud if it changed."""
        statements = available(self.robot, self.replicas, self.ports.now_s())
        if self.stated is None or [(s.node, s.reason) for s in statements] != [(s.node, s.reason) for s in self.stated]:
            self.stated = statements
            self.ports.available(statements)

    def next_deadline_s(self) -> float:
        """Return when the loss of the cloud is certain, to detect it to the millisecond, not at the next turn."""
        good_s = self.robot.situation.good_s
        if good_s is None or switcher.site(self.robot) is not Site.CLOUD:
            return float("inf")
        return good_s + self.settings.loss_timeout_s + DEADLINE_MARGIN_S

    def degraded(self) -> tuple[str, str] | None:
        """Return a problem for dead nodes that are not CORE, and for what the active side lacks."""
        dead, lacks = super().degraded(), readiness.lacking(self.robot)
        found = [dead[1]] if dead is not None else []
        if lacks is not None and switcher.site(self.robot) is Site.CLOUD:
            found.append(f"{lacks.reason}: {lacks.message}")
        if self.relay_status is not None:
            found += [f"{reason}: {message}" for reason, message in self.relay_status.lacking]
        return (managed_nodes.NodeEvent.DEGRADED, "; ".join(found)) if found else None

    def asleep(self) -> tuple[int, ...]:
        """Return the rated outputs, by index, whose node is known and not Active."""
        active = self._active()
        return tuple(i for i, (o, name) in enumerate(self._published) if o.rated and name and name not in active)

    def ready_changed(self, ready: bool) -> None:
        """Take the changed readiness of the robot's nodes."""
        specs = [n.spec for n in self.guardian.nodes if n.spec.duplicated]
        core = [spec for spec in specs if spec.core] or specs
        hot = bool(core) and all(spec.hot for spec in core)
        self.step(placement.NodesReported(ready, bool(specs), hot, self.told_asleep))

    # -- commands out -------------------------------------------------------------------------------------------------

    def step(self, event: placement.Event) -> None:
        """Step the placement machine and carry out its commands."""
        now_s = self.ports.now_s()
        self.robot, commands = self.watched(Machine.PLACEMENT, switcher.step, self.robot, event, now_s)
        for command in commands:
            self._carry_out(command)

    def _carry_out(self, command: placement.Command) -> None:
        match command:
            case SetGate():
                self._renew("collector", command)
            case placement.Permit():
                self.ports.send("pulse", Speak(self.incarnation, command.permission, self.ports.now_s()))
                self._order_data()
                self._order_relay()
            case Acting():
                self._act(command)
            case Reopen():
                for process in ("pulse", "data"):
                    self.ports.send(process, command)
            case placement.Answer():
                if command.key == FROM_CLOUD:
                    self.cloud_answer = f"{int(command.accepted)}|{command.message}"
                else:
                    self.ports.answer(command.key, command.accepted, command.message)
            case Decided():
                self._note_called_off(command)
                self.ports.decided(command)
            case _:
                assert_never(command)

    def _note_called_off(self, decided: Decided) -> None:
        """Keep the robot's nodes Active for a while if their preparation ended for goals or state."""
        if decided.phase is Phase.CLOUD and decided.verdict.reason in readiness.REASONS.values():
            self.rest.settle(self.ports.now_s() + self.settings.settle_for_s)

    def _act(self, command: Acting) -> None:
        """Pass the level to the guardian; nodes with goals still to end are kept Active meanwhile."""
        if self.rest.keeps_active(command.acting, self.ports.now_s()):
            command = replace(command, acting=True, in_charge=False)
        guardian = self.guardian
        known = (
            guardian.acting, guardian.outputs_flow, guardian.in_charge, guardian.stop, guardian.outputs_heard,
            guardian.silent,
        )  # fmt: skip
        in_charge = command.acting and command.in_charge
        if known != (
            command.acting, command.outputs_flow, in_charge, command.stop, command.outputs_heard, command.silent
        ):  # fmt: skip
            self.guard(command)

    def _active(self) -> tuple[str, ...]:
        return tuple(n.spec.name for n in self.guardian.nodes if n.state is State.ACTIVE)

    def _order_data(self) -> None:
        """Send identity and levels that the data process cannot see by itself."""
        prepared = switcher.prepared(self.robot)
        preparing = prepared.token.epoch if prepared is not None and prepared.site is Site.ROBOT else 0
        active = self._active() if self.robot.handing.kept else ()
        self._renew("data", Orders(self.incarnation, self.robot.epoch, self._answered_cloud(), preparing, active))

    def _order_relay(self) -> None:
        """Send what the relay cannot see by itself."""
        if not self.has_relay:
            return
        robot, now_s = self.robot, self.ports.now_s()
        report, prepared = robot.situation.report, switcher.prepared(robot)
        cloud_able = report is not None and report.serves == self.incarnation and report.ready
        sides = ((Site.ROBOT, robot.nodes_ready), (Site.CLOUD, cloud_able))
        orders = RelayOrders(
            self.incarnation, robot.link.peer, robot.last_epoch,
            None if prepared is None else (prepared.site, prepared.token), tuple(side for side, able in sides if able),
            self._active(), switcher.effects_site(robot, now_s), now_s,
        )  # fmt: skip
        self._renew("relay", orders)

    def _renew(self, process: str, message: SetGate | Orders | RelayOrders) -> None:
        """Send a level at once if it changed, else five times per lease: receivers can use an older one."""
        now_s = self.ports.now_s()
        level: Gate | Orders | RelayOrders
        if isinstance(message, SetGate):
            level = replace(message.gate, said_s=None)
        elif isinstance(message, RelayOrders):
            level = replace(message, said_s=0.0)
        else:
            level = message
        sent, sent_s = self.levels.get(process, (None, 0.0))
        if level != sent:
            self.ports.send(process, message)
        elif now_s - sent_s >= self.settings.lease_s / LEVELS_PER_LEASE:
            self.ports.renew(process, message)
        else:
            return
        self.levels[process] = level, now_s

    def _answered_cloud(self) -> str:
        """Return the answer to the cloud's last request, which our probes carry as a level."""
        return f"{self.asked_in_cloud}|{self.cloud_answer}" if self.asked_in_cloud else ""

    # -- what is shown ------------------------------------------------------------------------------------------------

    def take_effects(self) -> Site | None:
        """Return the side whose effects are admitted now, and record it as published."""
        self.effects = switcher.effects_site(self.robot, self.ports.now_s())
        return self.effects

    def sustained(self) -> int:
        """Return 1 if the link sustains the cloud, else 0."""
        now_s, heard_s = self.ports.now_s(), self.robot.link.heard_s
        alive = heard_s is not None and now_s - heard_s <= self.settings.loss_timeout_s
        return int(alive and health.fitness(self.robot.link, self.settings, now_s).ok)

    def missing_replicas(self) -> tuple[str, str] | None:
        """Return a problem if the connected cloud has not seen a duplicated node for a while."""
        now_s = self.ports.now_s()
        report = self.data_status.report if self.data_status else None
        unseen = [
            n.spec.name for n in self.guardian.nodes
            if n.spec.duplicated and self.replicas.get(n.spec.name, UNSEEN) == UNSEEN
        ]  # fmt: skip
        if not unseen or report is None or not report.connected or not self.replicas:
            self.complete_s = now_s
        if now_s - self.complete_s < REPLICA_GRACE_S:
            return None
        return "ReplicaMissing", f"No replica in the cloud of: {', '.join(unseen)}"
