"""What the cloud's data process does: inputs to the replicas, and the egress, which checks the lease per message."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, Protocol

from robot_offload_core.data import probe
from robot_offload_core.data.probe import Probe
from robot_offload_core.data.process import MAX_REPORT, DataPlan, DataPorts, DataProcess, others_of
from robot_offload_core.fence import envelope, lease
from robot_offload_core.fence.envelope import Envelope
from robot_offload_core.fence.token import Site, Token
from robot_offload_core.topics import mirror, tallies
from robot_offload_core.topics.mirror import Mirror
from robot_offload_core.topics.shared import Loop
from robot_offload_core.topics.waits import Waits
from robot_offload_core.words.events import CloudData, SetEgress
from robot_offload_core.words.messages import DataStatus, Egress, Limits, Reported
from robot_offload_core.words.reasons import Reason
from robot_offload_core.words.replace import replace
from robot_offload_core.words.topic_kinds import same_type
from robot_offload_core.words.veil import veil_token

REPORT_PERIOD_S = 0.2
"""Least time between two reports of the robot; faster ones are dropped, as one a second is enough."""
CLOSED = Egress("", "", SetEgress(None, 0.0))
MAX_LATCHED = 32
"""Values kept per latched topic."""


@dataclass
class Kept:
    """The newest message of a replica here.

    Attributes:
        payload: the message.
        robot, echo_us: sender and time stamp of the newest beat heard before the message was published. Its age is
            counted from that beat; if the message waited before we read it, the stamp is earlier by that wait.
        token, header: under which it left; None, b"" if it has not.
        said: consumers here have received it.
    """

    payload: Any
    robot: str
    echo_us: int
    token: Token | None = None
    header: bytes = b""
    said: bool = False


class CloudDataPorts(DataPorts, Protocol):
    """What else the shell does for the cloud's data process."""

    def publish_output(self, index: int, payload: Any) -> None:
        """Publish a message of output `index` to its consumers in the cloud."""

    def fill(self, index: int, payload: Any) -> None:
        """Publish on the replica's private topic what it would otherwise receive on the public topic."""

    def input_type(self, name: str) -> str:
        """Return the type under which an input is published, then a blank and its hash if known; "" if none yet."""

    def publish_input(self, name: str, payload: Any) -> bool:
        """Publish a message of an input to the replicas; return False while its type is unknown."""


class CloudDataProcess(DataProcess):
    """The cloud's data process.

    Attributes:
        egress: what may leave, from control.
        sequence: newest sequence of each output under its present token.
        first_result: first sequence of results, larger at each start of this process.
        newest: robot's incarnation and sequence of the newest message of each input; no older one is published.
        accepted: arrival of the newest message of each input, and the upper bound of its age then.
        spoke_s: when a replica last published each output, whether or not the message could leave.
        mirror: gate in front of the consumers in the cloud.
        kept: the newest message of each output.
        wanted: the robot's hash of each latched input.
        known_types: types of inputs, as last reported by the robot.
    """

    def __init__(self, plan: DataPlan, ports: CloudDataPorts) -> None:
        super().__init__(plan, ports)
        self.ports: CloudDataPorts = ports
        self.egress = CLOSED
        self.sequence: dict[tuple[int, Token], int] = {}
        # The token of presence outlives this process: a successor's results must be newer.
        self.first_result = round(ports.now_s() * 1e6)
        self.required = [i.name for i in plan.inputs if i.max_age_ms > 0]
        self.max_age_ms = {i.name: i.max_age_ms for i in plan.inputs}
        self.index = {output.name: index for index, output in enumerate(plan.outputs)}
        self.spoke_s: dict[int, float] = {}
        self.report_due_s = 0.0
        self.accepted: dict[str, tuple[float, float]] = {}
        self.ages = tallies.Ages()
        self.newest: dict[str, tuple[str, int]] = {}
        self.wanted: dict[str, str] = {}
        self.known_types: dict[str, str] = {}
        self.mirror = Mirror()
        self.kept: dict[int, Kept] = {}
        self.waits = [Waits() for _ in plan.outputs]
        specs = {i: output.spec for i, output in enumerate(plan.outputs) if output.spec is not None}
        self.loops = {i: Loop(spec) for i, spec in specs.items() if spec.shared}
        self.hot = {i: spec for i, spec in specs.items() if Site.CLOUD in spec.hot and not spec.of_cloud}
        self.last_values = {i for i, spec in specs.items() if spec.latched}

    # -- towards the robot --------------------------------------------------------------------------------------------

    def leave(self, index: int, payload: Any, published_s: float | None = None) -> None:
        """Send a message of a cloud node to the robot if the lease, checked now, is valid.

        Args:
            index: of the output.
            payload: the message.
            published_s: its publisher's stamp, by the system clock of that host; None: it has none.
        """
        output = self.plan.outputs[index]
        if index in self.loops:
            payload = self._of_replica(index, payload)
        if payload is None:
            return
        waited_s = self.waited_s(self.waits[index], published_s)
        self.spoke_s[index] = self.ports.now_s()
        if not self.fits(output.name, payload):
            return
        if self.pauses.waited(self.ports.now_s()) and output.rated:
            self.counters[f"{output.name}.waited"] += 1
            return
        egress, heard = self.egress.egress, self.heard
        if output.of_cloud and output.mirrored and self.plan.carried:  # no other side could be heard instead
            self._say(index, payload)
        message = Kept(payload, heard.incarnation if heard else "", heard.echo_us(waited_s) if heard else 0)
        with self.ports.lock:
            self.kept[index] = message
            token = lease.leaves(egress, self.ports.now_s(), of_cloud=output.of_cloud)
            if token is not None:
                self._seal(index, message, token)
                token = lease.leaves(egress, self.ports.now_s(), of_cloud=output.of_cloud)  # if we stood still
        if token is None:
            self.counters[f"{output.name}.held_back"] += 1
            return
        self._send(index, message)
        if not output.of_cloud:
            self._say_own(index, message)

    def _seal(self, index: int, message: Kept, token: Token) -> None:
        """Set the header and token under which a message leaves."""
        echo_us = message.echo_us if message.robot == token.robot else 0
        latched = index in self.last_values
        message.header = self.sealed(Envelope(token, self._next_sequence(index, token), echo_us, latched))
        message.token = token

    def sealed(self, header: Envelope) -> bytes:
        """Encode a header of ours, which names the robot by a hash unless the robot's agent is an older one."""
        return envelope.encode(replace(header, token=veil_token(header.token)) if self.egress.veils else header)

    def _send(self, index: int, message: Kept) -> None:
        name = self.plan.outputs[index].name
        sent = self.ports.cross(f"out/{name}", message.header, message.payload)
        self.counters[f"{name}.{'sent' if sent else 'unsent'}"] += 1

    def _say_own(self, index: int, message: Kept) -> None:
        """Publish a message that left to the consumers here, once the cloud is in charge under its token."""
        if not self.plan.outputs[index].mirrored or not self.plan.carried or message.token is None:
            return
        with self.ports.lock:
            egress = self.egress.egress
            in_charge = egress.in_charge and egress.token == message.token
            self.mirror, passes = mirror.own(self.mirror, message.token, in_charge=in_charge)
            if passes and not message.said:
                message.said = True
                self._say(index, message.payload)

    def _begin_stay(self) -> None:
        """Publish the newest message of each output that may stay silent for a while: the cloud is active now.

        A message that left while the cloud got ready may have reached the collector too early. So it leaves again under
        the same sequence, which lets it pass only once. Earlier messages of Hot replicas leave for the first time; the
        collector judges their age, except for latched messages.
        """
        egress = self.egress.egress
        for index, message in tuple(self.kept.items()):
            output = self.plan.outputs[index]
            token = lease.leaves(egress, self.ports.now_s())
            if token is None or output.of_cloud:
                continue
            with self.ports.lock:
                if message.token != token and index in self.hot and not output.rated:
                    self._seal(index, message, token)
            if message.token == token and not output.rated:
                self._send(index, message)
            self._say_own(index, message)

    def _say(self, index: int, payload: Any) -> None:
        """Publish to the consumers here."""
        if index in self.loops:
            self.loops[index].say(payload, self.ports.now_s())
        self.ports.publish_output(index, payload)

    def hear_others(self, index: int, payload: Any) -> None:
        """Pass on to the replica what other nodes publish on the public topic of a shared output here."""
        with self.ports.lock:
            said = self.loops[index].others(payload, self.ports.now_s())
        if said is not None:
            self.ports.fill(index, said)

    def look_at_frames(self, index: int, nodes: Collection[str]) -> None:
        """Record transform frames of our nodes that another publisher in the cloud publishes as well."""
        name = self.plan.outputs[index].name
        with self.ports.lock:
            taken = self.loops[index].taken(Site.CLOUD, nodes, self.ports.now_s())
        self.note(f"taken {name}", taken)

    def _of_replica(self, index: int, payload: Any) -> Any | None:
        """Return the part of a private-topic message that the replica itself published; None for a message of ours."""
        with self.ports.lock:
            return self.loops[index].replica(payload, self.ports.now_s())

    def _next_sequence(self, index: int, token: Token) -> int:
        """Return the sequence of the next message of an output under a token."""
        key = (index, token)
        if key not in self.sequence:
            for old in [k for k in self.sequence if k[0] == index]:
                del self.sequence[old]
            self.sequence[key] = self.first_result if self.plan.outputs[index].of_cloud else 0
        self.sequence[key] += 1
        return self.sequence[key]

    # -- from the robot -----------------------------------------------------------------------------------------------

    def carried_in(self, kind: str, name: str, opened: Envelope, header: bytes, payload: Any) -> None:
        """Take an input, a message that passed at the robot's collector, or one that others published on the robot."""
        del header
        if opened.token.robot != self.egress.robot or not opened.token.robot:
            self.counters[f"{name}.foreign"] += 1
            return
        if kind == "mirror":
            with self.ports.lock:
                self.mirror, passes = mirror.mirrored(self.mirror, opened.token)
                if passes and name in self.index:
                    self._say(self.index[name], payload)
            if passes and self.index.get(name) in self.loops:
                self._give_to_standby(self.index[name], payload)
            return
        if kind == "others" and self.index.get(name) in self.loops:
            self._take_others(self.index[name], name, opened, payload)
            return
        if kind == "in" and name in self.max_age_ms:
            self._take_input(name, opened, payload)

    def _take_input(self, name: str, opened: Envelope, payload: Any) -> None:
        """Publish a message of an input if it is young enough, newer than the last one and of the right type."""
        now_s = self.ports.now_s()
        known = opened.token.cloud == self.egress.incarnation  # else the echo is of another host's clock
        age_s = opened.age_s(now_s) if known else float("inf")
        if self.max_age_ms[name] and age_s * 1e3 > self.max_age_ms[name]:
            self.counters[f"{name}.too_old"] += 1
            return
        refusal = self._refusal(name, opened.token.robot)
        if refusal:  # a message that reaches no replica must not count as fresh
            self.counters[f"{name}.{refusal}"] += 1
            return
        source = (opened.token.robot, opened.sequence)
        with self.ports.lock:
            before = self.newest.get(name)
            if before is not None and before[0] == source[0] and before[1] >= source[1]:
                self.counters[f"{name}.reordered"] += 1
                return
            self.newest[name] = source
            self.accepted[name], self.came_s[name] = (now_s, age_s), now_s
            if name in self.latched:
                self._keep_latched(name, payload)
            else:
                self.ages.came(name, age_s, now_s)
        published = self.ports.publish_input(name, payload)
        self.counters[f"{name}.{'published' if published else 'no_type'}"] += 1

    def _refusal(self, name: str, robot: str) -> str:
        """Return why a message of an input must not be published, "" if it may.

        The robot's type counts as long as the same incarnation of the robot has reported it.
        """
        theirs = self.known_types.get(name, "") if self.probe and self.probe.incarnation == robot else ""
        if not theirs:
            return "no_type"
        ours = self.ports.input_type(name)
        return "" if not ours or same_type(ours, theirs) else Reason.TYPES_DIFFER.value

    def _give_to_standby(self, index: int, payload: Any) -> None:
        """Publish a message of the robot's replica on the private topic of the replica here."""
        with self.ports.lock:
            said = self.loops[index].holder(payload, self.ports.now_s())
        if said is not None:
            self.ports.fill(index, said)

    def _take_others(self, index: int, name: str, opened: Envelope, payload: Any) -> None:
        """Pass a message that a node outside the group published on the robot to the replica and the consumers here."""
        source, channel = (opened.token.robot, opened.sequence), others_of(name)
        with self.ports.lock:
            before = self.newest.get(channel)
            if before is not None and before[0] == source[0] and before[1] >= source[1]:
                self.counters[f"{name}.reordered"] += 1
                return
            self.newest[channel] = source
            known = channel in self.shared and payload in self.latched[channel]
            if channel in self.shared:
                self._keep_latched(channel, payload)
            if known:
                return
            said = self.loops[index].far(payload, self.ports.now_s())
            self._say(index, payload)
        self.ports.fill(index, said)
        self.counters[f"{name}.others"] += 1

    def repeat_others(self, index: int) -> None:
        """Fill in the latched messages of others again, because the publisher of the private topic is new."""
        for payload in tuple(self.latched.get(others_of(self.plan.outputs[index].name), ())):
            with self.ports.lock:
                said = self.loops[index].far(payload, self.ports.now_s())
            self.ports.fill(index, said)

    def _keep_latched(self, name: str, payload: Any) -> None:
        """Add a value and keep the newest values that together have the robot's hash."""
        self.latched[name] = [*[v for v in self.latched[name] if v != payload][1 - MAX_LATCHED :], payload]
        self._drop_older(name)

    def _drop_older(self, name: str) -> None:
        """Keep only the newest values that together have the robot's hash; all of them while none match."""
        values = self.latched[name]
        target = self.wanted.get(name, "")
        for start_at in range(1, len(values)):
            if probe.digest(values[start_at:]) == target:
                self.latched[name] = values[start_at:]
                break

    def watch(self, name: str) -> None:
        """Record that an input arrived by itself, as on DDS transports; only its silence can be judged there."""
        self.accepted[name] = (self.ports.now_s(), 0.0)

    # -- levels -------------------------------------------------------------------------------------------------------

    def order(self, message: object) -> None:
        """Take the lease from control."""
        if isinstance(message, Egress):
            before, self.egress = self.egress.egress, message
            if message.egress.in_charge and not (before.in_charge and message.egress.token == before.token):
                self._begin_stay()

    def limit(self, limits: Limits) -> None:
        """Take the age limit of each input."""
        self.max_age_ms.update({name: age_ms for name, age_ms, _ in limits.inputs})

    def make_probe(self) -> Probe:
        """Return a probe with identity, hashes held, types found in the graph, node states and a request."""
        egress = self.egress
        prepares = egress.egress.token is not None and not egress.egress.in_charge
        preparing = egress.egress.token.epoch if prepares and egress.egress.token is not None else 0
        return Probe(
            egress.incarnation, self.digests(), self._types(), dict(egress.nodes), egress.word,
            preparing=preparing, lacks=self.lacks,
        )  # fmt: skip

    def _types(self) -> dict[str, str]:
        """Return the types of the outputs here, and the types under which inputs are published."""
        inputs = {name: self.ports.input_type(name) for name in self.max_age_ms if name not in self.index}
        return self.ports.types() | {name: of for name, of in inputs.items() if of}

    def knows(self, incarnation: str) -> bool:
        """Return True for the robot served; a second one with the same identity must not disturb the first."""
        return bool(incarnation) and incarnation == self.egress.robot

    def reported(self, payload: Any) -> None:
        """Pass a report of the robot to control, unless it is too large or comes too soon."""
        now_s = self.ports.now_s()
        if len(payload) > MAX_REPORT or now_s < self.report_due_s:
            self.counters["garbage.report"] += 1
            return
        try:
            text = bytes(payload).decode()
        except UnicodeDecodeError:
            self.counters["garbage.report"] += 1
            return
        self.report_due_s = now_s + REPORT_PERIOD_S
        self.ports.send("control", Reported(text))

    def probed(self, received: Probe) -> None:
        """Take types and wanted hashes from the robot."""
        if received.latched != self.wanted:
            self.wanted = received.latched
            with self.ports.lock:
                for name in self.latched:
                    self._drop_older(name)
        types = {name: received.type_of(name) for name in received.types}
        for name, of in types.items():
            if name in self.latched and not same_type(self.known_types.get(name, of), of):
                with self.ports.lock:
                    self.latched[name] = []  # bytes of the type before mean something else now
        self.known_types = {**self.known_types, **types}

    def complete(self) -> bool:
        """Return whether all latched inputs here equal the robot's."""
        return all(self.latched.get(n) and self.digest(n) == h for n, h in self.wanted.items())

    def report(self, now_s: float, detailed: bool) -> None:
        """Report to control."""
        _, endpoint = self.ports.link_status()
        ages = tuple(
            None if name not in self.accepted else now_s - self.accepted[name][0] + self.accepted[name][1]
            for name in self.required
        )
        data = CloudData(self.probe_age_s(now_s), ages)
        problems, counters = self.details(detailed)
        if detailed:
            counters += tuple((f"{name}.age_ms", age_ms) for name, age_ms in self.ages.known(now_s))
        word = self.probe.word if self.probe else ""
        flowing = tuple(
            i for i, o in enumerate(self.plan.outputs)
            if o.rated and i in self.spoke_s and now_s - self.spoke_s[i] <= o.deadline_s
        )  # fmt: skip
        status = DataStatus(
            None, data, self.complete(), endpoint, word, (), problems, counters, flowing, self.occasions(now_s)
        )
        self.ports.send("control", status)
