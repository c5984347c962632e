"""What the robot's data process does: send inputs to the cloud, and hand the cloud's messages to the collector."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from robot_offload_core.data import probe
from robot_offload_core.data.probe import Probe
from robot_offload_core.data.process import DataPlan, DataPorts, DataProcess, others_of
from robot_offload_core.fence import envelope
from robot_offload_core.fence.envelope import Envelope
from robot_offload_core.fence.token import Site, Token
from robot_offload_core.topics.pacing import Pace, Paces
from robot_offload_core.topics.thinning import Thinning
from robot_offload_core.topics.waits import Waits
from robot_offload_core.words.events import DataReported, StateReported
from robot_offload_core.words.messages import ENVELOPE, OTHERS, PASSED, Carried, CloudTypes, DataStatus, Limits, Orders
from robot_offload_core.words.reasons import Reason
from robot_offload_core.words.replace import replace
from robot_offload_core.words.topic_kinds import same_type
from robot_offload_core.words.veil import unveil_token

RESEND_PERIOD_S = 0.5
"""How often latched values are sent again until the cloud shows that it holds them."""
OTHERS_AFTER_S = 0.5
"""Silence of our cloud's probes after which another agent's probes count: as long as control waits for them."""
MAX_LATCHED = 32
"""Values kept per latched topic; one per publisher, several for topics such as /tf_static."""
LATEST_S = 1.0
"""A message that waited this long for bandwidth is dropped as outdated."""
ARRIVED_S = 0.025
"""Delay of the report to control after the cloud's probe was due: by then it has arrived, unless it was lost."""
EARLY_SHARE = 0.8
"""Share of the least time between two messages after which one passes: else jitter could drop every second message."""


class RobotDataProcess(DataProcess):
    """The robot's data process.

    Attributes:
        sequence, sent_s: of each input.
        least_s: least time between two messages of each input.
        waiting: newest refused message of each input with `latest`: since when it waits, its header, its payload.
        hurries: control must know at once which outputs must publish (`while`).
        told: last report to control, without the values that always change.
        told_types: the cloud's types as last sent to the collector.
    """

    def __init__(self, plan: DataPlan, ports: DataPorts) -> None:
        super().__init__(plan, ports)
        self.orders = Orders("", 0)
        # Grows over restarts of this process: the cloud passes only what is newer.
        self.first_sequence = round(ports.now_s() * 1e6)
        self.sequence: dict[str, int] = {}
        self.sent_s: dict[str, float] = {}
        self.resent_s: dict[str, float] = {}
        self.index = {output.name: index for index, output in enumerate(plan.outputs)}
        self.aged = {i.name for i in plan.inputs if i.max_age_ms > 0}
        self.least_s: dict[str, float] = {}
        self.waits = {i.name: Waits() for i in plan.inputs}
        self.thinning = {i.name: Thinning(ports.now_s()) for i in plan.inputs}
        self.paces = Paces((i.name, Pace(1 / i.min_rate_hz if i.min_rate_hz else 0.0, i.priority)) for i in plan.inputs)
        self.latest = {i.name for i in plan.inputs if i.latest}
        self.waiting: dict[str, tuple[float, bytes, Any]] = {}
        self.told: tuple[object, ...] = ()
        self.told_types: tuple[tuple[str, str], ...] | None = None
        self.hurries = any(o.spec is not None and o.spec.while_ is not None for o in plan.outputs)
        self._limit_rates((i.name, i.max_age_ms, i.rate_hz) for i in plan.inputs)

    def forward(self, name: str, payload: Any, publishers: int = 1, published_s: float | None = None) -> None:
        """Send an input's message to the cloud.

        Args:
            name: of the input.
            payload: the message.
            publishers: number of publishers; this many values of a latched topic are kept.
            published_s: its publisher's stamp, by the system clock of that host; None: it has none.
        """
        now_s = self.came_s[name] = self.ports.now_s()
        waited_s = 0.0 if name in self.latched else self.waited_s(self.waits[name], published_s)
        if self.pauses.waited(now_s) and name in self.aged:
            self.counters[f"{name}.waited"] += 1
            return
        if not self.fits(name, payload):
            return
        if now_s - self.sent_s.get(name, 0.0) < EARLY_SHARE * self.least_s[name]:
            self.counters[f"{name}.rate_limited"] += 1
            return
        if not self.paces.passes(name, now_s):
            self.counters[f"{name}.thinned"] += 1
            self.thinning[name].count(0, sent=False)
            return
        self.sent_s[name] = now_s
        if name in self.latched:
            with self.ports.lock:
                values = [v for v in self.latched[name] if v != payload]
                self.latched[name] = [*values, payload][-min(MAX_LATCHED, max(1, publishers)) :]
        self.send_input(name, payload, waited_s)

    def send_input(self, name: str, payload: Any, waited_s: float = 0.0) -> None:
        """Send a message that waited `waited_s` for us, with a header that lets the cloud bound its age."""
        header = self._header(name, waited_s)
        sent = self._cross_input(name, header, payload)
        with self.ports.lock:
            replaced = self.waiting.pop(name, None)
            if not sent and name in self.latest:
                self.waiting[name] = self.ports.now_s(), header, payload
        # A waiting message may still be sent in time; if the next one replaces it, the link carries too little.
        left_out = not sent and (name not in self.latest or replaced is not None)
        if left_out and self.ports.link_status()[0]:
            self.paces.refused(name, self.ports.now_s())

    def _header(self, name: str, waited_s: float = 0.0) -> bytes:
        heard = self.heard
        with self.ports.lock:
            sequence = self.sequence[name] = self.sequence.get(name, self.first_sequence) + 1
        token = Token(self.orders.incarnation, self.orders.epoch, heard.incarnation if heard else "")
        return envelope.encode(Envelope(token, sequence, heard.echo_us(waited_s) if heard else 0))

    def _cross_input(self, name: str, header: bytes, payload: Any) -> bool:
        """Send an input's message; return whether the link took it."""
        sent = self.ports.cross(f"in/{name}", header, payload)
        self.counters[f"{name}.{'sent' if sent else 'unsent'}"] += 1
        self.thinning[name].count(len(payload) if sent else 0, sent=sent)
        return sent

    def room(self, name: str) -> None:
        """Send the waiting message of an input, as the link has room again; its age counts from its arrival here."""
        with self.ports.lock:
            waiting = self.waiting.pop(name, None)
        if waiting is None or self.ports.now_s() - waiting[0] > LATEST_S:
            return
        sent = self.ports.cross(f"in/{name}", *waiting[1:])
        self.counters[f"{name}.sent_later"] += sent
        if sent:
            self.thinning[name].count_later(len(waiting[2]))

    def order(self, message: object) -> None:
        """Take the identity from control, or a message from the collector for the cloud."""
        if isinstance(message, Orders):
            if message.preparing != self.orders.preparing:
                self.status_due_s = self.ports.now_s()
            self.orders = message
        elif isinstance(message, Carried) and message.kind in (PASSED, OTHERS) and self.plan.carried:
            if message.index >= len(self.plan.outputs):
                self.counters["garbage.bus"] += 1
                return
            name = self.plan.outputs[message.index].name
            if not self.fits(name, message.payload):
                return
            if message.kind == OTHERS and others_of(name) in self.shared:
                self._keep_others(others_of(name), message.payload)
                return
            channel = f"mirror/{name}" if message.kind == PASSED else others_of(name)
            self.ports.cross(channel, message.header, message.payload)

    def _keep_others(self, channel: str, payload: Any) -> None:
        """Keep a latched message of a node outside the group, and send it if it is new."""
        with self.ports.lock:
            if payload in self.latched[channel]:
                return
            self.latched[channel] = [*self.latched[channel], payload][-MAX_LATCHED:]
        self.sent_s[channel] = self.ports.now_s()
        self.ports.cross(channel, self._header(channel), payload)

    def limit(self, limits: Limits) -> None:
        """Take the rate limit of each input."""
        self._limit_rates(limits.inputs)

    def _limit_rates(self, limits: Iterable[tuple[str, float, float]]) -> None:
        self.least_s.update({name: 1 / rate_hz if rate_hz else 0.0 for name, _, rate_hz in limits})

    def make_probe(self) -> Probe:
        """Return a probe with identity, hashes of latched inputs, types found in the graph and a request's answer."""
        found = {name: of.partition(" ") for name, of in self.ports.types().items()}
        types = {name: parts[0] for name, parts in found.items()}
        hashes = {name: parts[2] for name, parts in found.items() if parts[2]}
        return Probe(self.orders.incarnation, self.digests(), types, word=self.orders.word, hashes=hashes)

    def knows(self, incarnation: str) -> bool:
        """Return True for the cloud that the pulse process hears, and for any other while that cloud is silent here.

        Control compares the incarnation with the one that the pulse process hears. Of two cloud agents (DDS) the one
        that is heard stays.
        """
        partner = self.heard.incarnation if self.heard else ""
        age_s = self.probe_age_s(self.ports.now_s())
        ours = self.probe is not None and self.probe.incarnation == partner
        live = ours and age_s is not None and age_s <= OTHERS_AFTER_S
        return bool(incarnation) and (incarnation == partner or not live)

    def probed(self, received: Probe) -> None:
        """Send latched values again that the cloud does not hold, and pass its types to the collector."""
        now_s = self.ports.now_s()
        self._compare_inputs(received)
        types = tuple(sorted((name, of) for name, of in received.types.items() if name in self.index))
        tell = self.ports.renew if types == self.told_types else self.ports.send
        self.told_types = types
        tell("collector", CloudTypes(types))
        for name, values in self.latched.items():
            if not values or received.latched.get(name) == self.digest(name):
                continue
            last_s = max(self.resent_s.get(name, 0.0), self.sent_s.get(name, 0.0))  # what the cloud says may be older
            if now_s - last_s >= RESEND_PERIOD_S:
                self.resent_s[name] = now_s
                for value in list(values):
                    if name in self.shared:
                        self.ports.cross(name, self._header(name), value)
                    else:
                        self.send_input(name, value)

    def _compare_inputs(self, received: Probe) -> None:
        """Record inputs that the cloud publishes under another type than the robot: none of their messages arrive."""
        ours = self.ports.types()
        for name in self.thinning.keys() - self.index.keys():
            here, there = ours.get(name, ""), received.types.get(name, "")
            same = not here or not there or same_type(here, there)
            message = f"Input {name} is {here} here and {there} in the cloud"
            self.note(f"type {name}", None if same else (Reason.TYPES_DIFFER.value, message))

    def opened(self, header: bytes) -> Envelope:
        """Decode a header of the cloud, which names us by a hash; raise EnvelopeError if it is not valid."""
        read = envelope.decode(header)
        return replace(read, token=unveil_token(read.token, self.orders.incarnation))

    def carried_in(self, kind: str, name: str, opened: Envelope, header: bytes, payload: Any) -> None:
        """Hand a message of the cloud's replica to the collector, with our own incarnation in the header."""
        header = envelope.encode(opened)
        if kind == "out" and name in self.index:
            delivered = self.ports.carry("collector", ENVELOPE, self.index[name], header, payload)
            self.counters[f"{name}.{'arrived' if delivered else 'undelivered'}"] += 1

    def next_status_s(self, now_s: float) -> float:
        """Return when to report again: after the cloud's next probe, or sooner while something is under way."""
        received, heard_s = self.probe, self.probe_s
        usual_s = super().next_status_s(now_s)
        if self.hurries or received is None or received.preparing or heard_s is None or self.orders.preparing:
            return usual_s
        if self.lacks or received.lacks or now_s - heard_s > 2 * probe.PROBE_PERIOD_S:
            return usual_s
        due_s = heard_s + probe.PROBE_PERIOD_S + ARRIVED_S
        return due_s if due_s >= usual_s else due_s + probe.PROBE_PERIOD_S

    def _lacking(self, site: Site, preparing: int, lacks: dict[str, str]) -> StateReported:
        """Return the report to control of what a side lacks of the other side's state."""
        before_active = tuple(why for name, why in lacks.items() if name in self.before_active)
        return StateReported(site, preparing, tuple(lacks.values()), before_active)

    def report(self, now_s: float, detailed: bool) -> None:
        """Report to control."""
        connected, endpoint = self.ports.link_status()
        for name, thinning in self.thinning.items():
            if thinning.is_due(now_s):
                slowest_s = self.paces.of[name].slowest_s
                found = thinning.judge(name, now_s, connected=connected, slowest_s=slowest_s)
                self.note(f"thinned {name}", found)
        received = self.probe
        report = DataReported(connected, self.probe_age_s(now_s), received.incarnation if received else "")
        replicas = tuple(sorted(received.nodes.items())) if received and detailed else ()
        word = received.word if received else ""
        problems, counters = self.details(detailed)
        states: tuple[StateReported, ...] = (self._lacking(Site.ROBOT, self.orders.preparing, self.lacks),)
        if received is not None:
            states += (self._lacking(Site.CLOUD, received.preparing, received.lacks),)
        status = DataStatus(
            report,
            None,
            True,
            endpoint,
            word,
            replicas,
            problems,
            counters,
            occasions=self.occasions(now_s),
            states=states,
        )
        level = (connected, report.cloud, report.age_s is None, word, status.occasions, states)
        tell = self.ports.renew if level == self.told else self.ports.send
        self.told = level
        tell("control", status)
