"""What the collector process does with each message and each order of control.

Not safe for several threads by itself: the shell holds one lock around every call.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from robot_offload_core.collector import gate, results, rivals, standby
from robot_offload_core.collector.state import Collector
from robot_offload_core.fence import envelope
from robot_offload_core.fence.envelope import Envelope, EnvelopeError
from robot_offload_core.fence.gate import Charge
from robot_offload_core.fence.token import Site, Token
from robot_offload_core.topics import tallies
from robot_offload_core.topics.pauses import Pauses
from robot_offload_core.topics.shared import MAX_LATCHED_OF_OTHERS, Loop
from robot_offload_core.topics.tallies import GAP_MS, bucket
from robot_offload_core.words import gates
from robot_offload_core.words.gates import Passage, Ruling
from robot_offload_core.words.messages import (
    ENVELOPE,
    OTHERS,
    PASSED,
    Carried,
    CloudTypes,
    CollectorStatus,
    Limits,
    SetGate,
)
from robot_offload_core.words.problems import Problem
from robot_offload_core.words.reasons import Reason
from robot_offload_core.words.settings import OutputSpec
from robot_offload_core.words.topic_kinds import same_type

TURN_S = 0.060
"""Most time between two looks for changes that control must know.

The process also looks with every message, and when the next deadline passes.
"""
DEADLINE_MARGIN_S = 0.0005
"""Added to a deadline, so that one look finds it passed."""
REPORTS_PER_LEASE = 5
"""Reports to control per lease, at least ten a second; a report without news does not wake control."""
EARLY_S = 0.020
"""A report due within this time goes out with a message that just came: a wake-up costs more than the report."""
SLACK_S = 0.010
"""How long a due report waits for the next message, so that one wake-up serves both."""
REPEAT_PERIOD_S = 5.0
"""How often the data process gets the latched messages of others again: it may have restarted."""
DETAIL_PERIOD_S = 1.0
"""How often problems, counters and ages go to control; reports in between carry none."""


class CollectorPorts(Protocol):
    """What the shell does for the collector."""

    def now_s(self) -> float:
        """Return the steady clock, seconds."""

    def send(self, to: str, message: object) -> bool:
        """Send a message to another process of this agent."""

    def renew(self, to: str, message: object) -> bool:
        """Send a level that has not changed: it is read when its receiver wakes for another reason."""

    def carry(self, to: str, kind: bytes, index: int, header: bytes, payload: Any) -> bool:
        """Send an output's message with its header to another process of this agent."""

    def topics_of(self, index: int) -> tuple[str, str]:
        """Return the public topic of output `index` and the private one of the robot's replica, for problem texts."""

    def publish(self, index: int, payload: Any) -> None:
        """Publish a message to the consumers of output `index`."""

    def fill(self, index: int, payload: Any) -> None:
        """Publish on the private topic of the robot's replica what it would otherwise receive on the public one."""

    def type_of(self, index: int) -> str:
        """Return the interface type that output `index` is published with, "" while there is no publisher.

        The type's hash follows after a blank if the middleware provides one.
        """

    def save(self, state: Collector) -> None:
        """Save which side passes now, for the successor of this process."""

    def fell_silent(self) -> None:
        """Log that control has been silent for too long."""


@dataclass(frozen=True)
class CollectorPlan:
    """Configuration of the collector.

    Attributes:
        outputs: the collected outputs.
        mirrored: per output, whether consumers in the cloud get the messages that pass.
        max_age_s, lease_s, loss_timeout_s, activation_s: see `collectors.Collector`.
    """

    outputs: tuple[OutputSpec, ...]
    mirrored: tuple[bool, ...]
    max_age_s: float
    lease_s: float
    loss_timeout_s: float = 0.0
    activation_s: float = 0.0


class CollectorProcess:
    """The collector and what surrounds its machine: held messages, the mirror, pauses, reports.

    Attributes:
        state: of the machine.
        held: newest message per output of the side that gets ready.
        standby: newest message of each Hot replica on the robot.
        passed_s: when each rated output last passed.
        sequence: of the robot's messages; grows over restarts of this process.
        problems: by key, for diagnostics.
        counters: per output, side and reason.
        cloud_types: types of the outputs in the cloud, as its data process reports.
        strangers: nodes outside the group that publish a shared output, by its index.
        latched_others: their last messages on each latched shared output.
        ages: of the newest message of the cloud, by output.
        silence: around the last change of side.
    """

    def __init__(
        self, plan: CollectorPlan, ports: CollectorPorts, remembered: tuple[Charge, int, bool, int] | None = None
    ) -> None:
        now_s = ports.now_s()
        self.plan = plan
        self.ports = ports
        self.state = gate.start(plan.outputs, plan.max_age_s, plan.lease_s, plan.loss_timeout_s, plan.activation_s)
        if remembered is not None:
            charge, started_us, fell_back, stay = remembered
            self.state = gate.resume(self.state, charge, started_us, fell_back, now_s, stay)
        self.pauses = Pauses(now_s)
        self.sequence = round(now_s * 1e6)
        self.held: dict[int, Any] = {}
        self.standby: dict[int, Any] = {}
        self.passed_s: dict[int, float] = {}
        self.counters: Counter[str] = Counter(cloud_garbage=0)  # never empty: control takes a detailed report by it
        self.problems: dict[str, tuple[str, str]] = {}
        self.cloud_types: dict[str, str] = {}
        self.loops = {index: Loop(spec) for index, spec in enumerate(plan.outputs) if spec.shared}
        self.strangers: dict[int, tuple[str, ...]] = {}
        self.latched_others: dict[int, deque[Any]] = {}
        self.ages = tallies.Ages()
        self.silence = tallies.SwitchSilence(gate.site(self.state))
        self.detail_due_s = self.report_due_s = self.repeat_due_s = 0.0
        self.report_period_s = report_period_s(plan.lease_s)
        self.reported: gates.GateReport | None = None

    def note(self, key: str, problem: tuple[str, str] | None) -> None:
        """Keep or clear a problem for diagnostics."""
        if problem is None:
            self.problems.pop(key, None)
        else:
            self.problems[key] = problem

    def rival(self, index: int, nodes: Sequence[str]) -> str:
        """Record other publishers of an output's public topic; return a message about them, "" for none."""
        name = self.plan.outputs[index].name
        topic, private = self.ports.topics_of(index)
        message = f"{topic} has another publisher: {', '.join(nodes)}; remap its output to {private}" if nodes else ""
        if index in self.loops:
            self.strangers[index] = tuple(nodes)  # welcome there
            return ""
        self.note(f"public {name}", (Reason.SECOND_PUBLISHER.value, message) if nodes else None)
        return message

    def twins(self, index: int, nodes: list[str]) -> None:
        """Record the processes that publish an output's private topic, if there are several."""
        _, private = self.ports.topics_of(index)
        self.note(f"twins {self.plan.outputs[index].name}", rivals.twins_problem(private, nodes))

    def compare_types(self) -> None:
        """Record each output whose types on the two sides differ."""
        for index, spec in enumerate(self.plan.outputs):
            ours, theirs = self.ports.type_of(index), self.cloud_types.get(spec.name, "")
            message = f"Output {spec.name} is {ours} here and {theirs} in the cloud"
            differs = bool(ours and theirs) and not same_type(ours, theirs)
            self.note(f"type {spec.name}", (Reason.TYPES_DIFFER.value, message) if differs else None)

    def _look_at_frames(self) -> None:
        """Record undeclared frames, frames that other nodes publish too, and messages that are not transforms."""
        now_s = self.ports.now_s()
        for index, loop in self.loops.items():
            name, frames = self.plan.outputs[index].name, ", ".join(sorted(loop.undeclared))
            message = f"The group publishes frames on {name} that are not declared and reach nobody: {frames}"
            self.note(f"frames {name}", (Problem.FRAME_UNDECLARED, message) if frames else None)
            self.note(f"taken {name}", loop.taken(Site.ROBOT, self.strangers.get(index, ()), now_s))
            if loop.strange:
                self.counters[f"{name}.no_transforms"] = loop.strange

    def _refusal(self, index: int) -> str:
        """Return why no message of the cloud can be published on this output, "" if messages can."""
        ours, theirs = self.ports.type_of(index), self.cloud_types.get(self.plan.outputs[index].name, "")
        if not ours or not theirs:
            return "NoType"
        return "" if same_type(ours, theirs) else Reason.TYPES_DIFFER.value

    # -- messages of the two replicas ---------------------------------------------------------------------------------

    def offer_robot(self, index: int, payload: Any) -> None:
        """Take a message of the robot's replica; drop it if it is of a rated output and waited through a pause."""
        now_s = self.ports.now_s()
        spec = self.plan.outputs[index]
        if index in self.loops:
            payload = self.loops[index].replica(payload, now_s)
            if payload is None:
                return
        if self.pauses.waited(now_s) and spec.deadline_s:
            self.counters[f"{spec.name}.robot.waited"] += 1
            return
        self.sequence += 1
        state, passage = gate.offer_robot(self.state, index, self.sequence, now_s)
        if spec.hot:
            self.standby[index] = payload
        changed = self._keep(state)
        published = self._publish(index, payload, passage)
        self._count("robot", index, passage)
        if changed:
            self.report()
        self._mirror(published)

    def _mirror(self, published: list[tuple[int, Any]]) -> None:
        """Send messages of the robot that passed to consumers in the cloud."""
        differ = Reason.TYPES_DIFFER.value  # the cloud would publish the bytes under its own type
        mirrored = [
            (other, passed) for other, passed in published
            if self.plan.mirrored[other] and self._refusal(other) != differ
        ]  # fmt: skip
        if not mirrored:
            return
        header = self._header()
        for other, passed in mirrored:
            self.ports.carry("data", PASSED, other, header, passed)

    def _header(self) -> bytes:
        charge = self.state.charge
        token = charge.token if charge is not None else Token("", 0, "")
        return envelope.encode(Envelope(token, self.sequence, 0))

    def hear_others(self, index: int, payload: Any) -> None:
        """Pass on to the replicas what other nodes publish on the public topic of a shared output."""
        said = self.loops[index].others(payload, self.ports.now_s())
        if said is None:
            return
        self.sequence += 1
        self.ports.fill(index, said)
        self.ports.carry("data", OTHERS, index, self._header(), said)
        if self.plan.outputs[index].latched:
            values = self.latched_others.setdefault(index, deque(maxlen=MAX_LATCHED_OF_OTHERS))
            if said in values:
                values.remove(said)
            values.append(said)
        self.counters[f"{self.plan.outputs[index].name}.others"] += 1

    def _repeat_others(self, now_s: float) -> None:
        """Send the latched messages of others again to the data process, which may have restarted."""
        if now_s < self.repeat_due_s:
            return
        self.repeat_due_s = now_s + REPEAT_PERIOD_S
        for index, values in self.latched_others.items():
            for said in values:
                self.ports.carry("data", OTHERS, index, self._header(), said)

    def offer_cloud(self, message: Carried) -> None:
        """Take a message of the cloud's replica, handed over by the data process."""
        index = message.index
        try:
            header = envelope.decode(message.header)
        except EnvelopeError:
            self.counters["cloud_garbage"] += 1
            return
        if index >= len(self.plan.outputs):
            self.counters["cloud_garbage"] += 1
            return
        refusal = self._refusal(index)
        if refusal:  # a message that reaches no consumer must not count as passed
            self.counters[f"{self.plan.outputs[index].name}.cloud.{refusal}"] += 1
            return
        offer = results.offer if self.plan.outputs[index].of_cloud else gate.offer_cloud
        now_s = self.ports.now_s()
        state, passage = offer(self.state, index, header, now_s)
        self.ages.came(self.plan.outputs[index].name, header.age_s(now_s), now_s)
        changed = self._keep(state)
        for other, passed in self._publish(index, message.payload, passage):
            if other in self.loops:
                self._give_to_standby(other, passed)
        self._count("cloud", index, passage)
        if changed:
            self.report()

    def _publish(self, index: int, payload: Any, passage: Passage) -> list[tuple[int, Any]]:
        """Publish a message or hold it for the changeover, as the machine ruled; return all that was published."""
        if passage.reason is Ruling.NOT_ALL_READY:
            self.held[index] = payload
        if not passage.passes:
            return []
        kept = self.standby | self.held if self.state.charge and self.state.charge.site is Site.ROBOT else self.held
        passing = [(other, kept[other]) for other in passage.also if other in kept] + [(index, payload)]
        if passage.reason is Ruling.CHANGED_OVER:
            self.held.clear()
        for other, held in passing:
            if other in self.loops:
                self.loops[other].say(held, self.ports.now_s())
            self.ports.publish(other, held)
            self._count_gap(other)
        return passing

    def look_due_s(self) -> float:
        """Return when `report` is needed before the next turn, because a message of the cloud counts as lost then."""
        return standby.next_look_s(self.state, self.ports.now_s())

    def turn_due_s(self) -> float:
        """Return when to look again if no message comes: at the next deadline, after TURN_S at the latest."""
        now_s = self.ports.now_s()
        deadline_s = min(gate.next_deadline_s(self.state, now_s) + DEADLINE_MARGIN_S, self.look_due_s())
        return min(deadline_s, max(now_s, self.report_due_s + SLACK_S), now_s + TURN_S)

    def _release(self, before: Collector) -> None:
        """Publish the kept messages of the robot's Hot replicas if the robot has taken over."""
        self.state, outputs = standby.release(before, self.state, self.ports.now_s())
        passing = [(index, self.standby[index]) for index in outputs if index in self.standby]
        for index, payload in passing:
            if index in self.loops:
                self.loops[index].say(payload, self.ports.now_s())
            self.ports.publish(index, payload)
            self._count_gap(index)
            self._count("robot", index, Passage(Ruling.RELEASED))
        self._mirror(passing)

    def _give_to_standby(self, index: int, payload: Any) -> None:
        """Publish a message of the cloud's replica on the private topic of the robot's replica."""
        said = self.loops[index].holder(payload, self.ports.now_s())
        if said is not None:
            self.ports.fill(index, said)

    def _count(self, side: str, index: int, passage: Passage) -> None:
        name = self.plan.outputs[index].name
        self.counters[f"{name}.{side}.{'passed' if passage.passes else passage.reason}"] += 1

    def _count_gap(self, index: int) -> None:
        """Count the time since a rated output last passed, as the driver sees it."""
        spec, now_s = self.plan.outputs[index], self.ports.now_s()
        if not spec.deadline_s:
            return
        before_s, self.passed_s[index] = self.passed_s.get(index), now_s
        if before_s is not None:
            gap_ms = (now_s - before_s) * 1e3
            self.silence.ended(before_s, now_s)
            self.counters[f"{spec.name}.gap_ms.{bucket(GAP_MS, gap_ms)}"] += 1
            self.counters[f"{spec.name}.gap_sum_ms"] += round(gap_ms)
            self.counters[f"{spec.name}.overdue_ms"] += max(0, round(gap_ms - spec.deadline_s * 1e3))

    def _keep(self, state: Collector) -> bool:
        """Take over the next state; save and return whether the charge that passes has changed."""
        before, self.state = self.state, gate.count_stay(self.state, state)
        state = self.state
        changed = (before.charge, before.fell_back) != (state.charge, state.fell_back)
        if changed:
            self.ports.save(state)
            self.silence.passes(gate.site(state), self.ports.now_s())
        return changed

    # -- orders of control --------------------------------------------------------------------------------------------

    def handle(self, message: object) -> None:
        """Take one datagram of another process."""
        if isinstance(message, SetGate):
            before = self.state
            if self._keep(gate.set_gate(before, message.gate, self.ports.now_s())):
                self._release(before)
                self.report()
        elif isinstance(message, Carried) and message.kind == ENVELOPE:
            self.offer_cloud(message)
        elif isinstance(message, CloudTypes):
            self.cloud_types = dict(message.types)
        elif isinstance(message, Limits):
            self.report_period_s = report_period_s(message.gate_timeout_s)
            limits = message.max_command_age_s, message.gate_timeout_s, message.loss_timeout_s, message.activation_s
            self.state = gate.limit(self.state, *limits)

    def woke(self) -> None:
        """Record a sign of life of this process; a long gap between two is a pause."""
        self.pauses.waited(self.ports.now_s())

    def report(self, *, only_news: bool = False) -> None:
        """Report to control, and detect that control fell silent."""
        now_s = self.ports.now_s()
        before = self.state
        if self._keep(gate.turn(before, now_s)):
            self.ports.fell_silent()
            self._release(before)
        self.state = standby.look(self.state, now_s)
        report = gate.report(self.state, now_s)
        news = report != self.reported or not only_news
        if not news and now_s < self.report_due_s - EARLY_S:
            return
        self.reported, self.report_due_s = report, now_s + self.report_period_s
        status = CollectorStatus(report)
        if now_s >= self.detail_due_s:
            self.detail_due_s = now_s + DETAIL_PERIOD_S
            self.compare_types()
            self._look_at_frames()
            self._repeat_others(now_s)
            problems, counters = tuple(self.problems.values()), tuple(sorted(self.counters.items()))
            status = CollectorStatus(report, problems, counters, self.ages.known(now_s), self.silence.known(now_s))
        (self.ports.send if news else self.ports.renew)("control", status)


def report_period_s(lease_s: float) -> float:
    """Return the longest time between two reports to control, seconds."""
    return min(0.1, lease_s / REPORTS_PER_LEASE)
