"""The robot's data process: inputs to the cloud, the cloud's envelopes to the collector."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial

from robot_offload_agent.data import probe
from robot_offload_agent.data.process import DataProcess, start
from robot_offload_agent.process.bus import ENVELOPE, PASSED, Bus, Carried, DataStatus, Limits, Orders
from robot_offload_agent.process.clock import now_s
from robot_offload_agent.ros import raw
from robot_offload_agent.settings import offer, store
from robot_offload_agent.settings.parameters import Configuration
from robot_offload_core import envelope
from robot_offload_core.placement import DataReported
from robot_offload_core.token import Token

RESEND_PERIOD_S = 0.5
"""Latched values are sent again this often until the cloud shows that it holds them."""
MAX_LATCHED = 32
"""Values kept per latched topic; one per publisher, several for topics such as /tf_static."""


class RobotSideData(DataProcess):
    """See the module."""

    def __init__(self, configuration: Configuration, bus: Bus) -> None:
        super().__init__(configuration, bus)
        self.orders = Orders("", 0)
        self.sequence: dict[str, int] = {}
        self.sent_s: dict[str, float] = {}
        self.latched: dict[str, list[bytes]] = {i.name: [] for i in configuration.inputs if i["latched"]}
        self.resent_s: dict[str, float] = {}
        self.index = {o.name: i for i, o in enumerate(configuration.outputs)}
        self.inputs = [
            raw.RawSubscription(self.node, i["topic"], i, i["latched"], partial(self.forward, i.name))
            for i in (configuration.inputs if self.carried else ())
        ]
        self.aged = {i.name for i in configuration.inputs if i["max_age_ms"] > 0}
        self.least_s: dict[str, float] = {}
        self.limit_rates(offer.input_limits(store.in_force(configuration)))

    def resolve(self) -> bool:
        """Subscribes to inputs that have got a publisher."""
        resolved = [subscription.resolve() for subscription in self.inputs]
        for subscription in self.inputs:
            self.note(f"input {subscription.spec.name}", subscription.problem)
        return all(resolved)

    def forward(self, name: str, payload: bytes) -> None:
        """An input's message, on the ROS thread."""
        now = now_s()
        if self.pauses.waited(now) and name in self.aged:
            self.counters[f"{name}.waited"] += 1
            return
        # A fifth of the least distance is let pass early: publishers jitter, and every second message must not fall.
        if now - self.sent_s.get(name, 0.0) < 0.8 * self.least_s[name]:
            self.counters[f"{name}.rate_limited"] += 1
            return
        self.sent_s[name] = now
        if name in self.latched:
            publishers = max(1, self.node.count_publishers(self.configuration_topic(name)))
            with self.lock:
                store = [v for v in self.latched[name] if v != payload]
                self.latched[name] = [*store, payload][-min(MAX_LATCHED, publishers) :]
        self.send_input(name, payload)

    def configuration_topic(self, name: str) -> str:
        """The topic of an input."""
        return next(i["topic"] for i in self.configuration.inputs if i.name == name)

    def send_input(self, name: str, payload: bytes) -> None:
        """With a header that lets the cloud bound its age."""
        heard = self.heard
        with self.lock:
            sequence = self.sequence[name] = self.sequence.get(name, 0) + 1
        token = Token(self.orders.incarnation, self.orders.epoch, heard.incarnation if heard else "")
        header = envelope.encode(envelope.Envelope(token, sequence, heard.sent_us if heard else 0))
        sent = self.link.send(f"in/{name}", header, payload)
        self.counters[f"{name}.{'sent' if sent else 'unsent'}"] += 1

    def order(self, message: object) -> None:
        """Identity from control; what passed, from the collector, for consumers in the cloud."""
        if isinstance(message, Orders):
            self.orders = message
        elif isinstance(message, Carried) and message.kind == PASSED and self.carried:
            name = self.configuration.outputs[message.index].name
            self.link.send(f"mirror/{name}", message.header, message.payload)

    def limit(self, limits: Limits) -> None:
        """The rates of the inputs."""
        self.limit_rates(limits.inputs)

    def limit_rates(self, limits: Iterable[tuple[str, float, float]]) -> None:
        """The least distance of two messages of each input."""
        self.least_s.update({name: 1 / rate_hz if rate_hz else 0.0 for name, _, rate_hz in limits})

    def make_probe(self) -> probe.Probe:
        """Identity, hashes of latched inputs, types found in the graph."""
        with self.lock:
            latched = {name: probe.digest(values) for name, values in self.latched.items() if values}
        types = {s.spec.name: s.type_name for s in self.inputs if s.type_name}
        return probe.Probe(self.orders.incarnation, latched, types, word=self.orders.word)

    def knows(self, incarnation: str) -> bool:
        """Any cloud: control compares it with the one that the pulse hears."""
        return bool(incarnation)

    def probed(self, received: probe.Probe) -> None:
        """Sends latched values again that the cloud does not hold (a new session, a restarted agent)."""
        now = now_s()
        for name, values in self.latched.items():
            if not values or received.latched.get(name) == probe.digest(values):
                continue
            if now - self.resent_s.get(name, 0.0) >= RESEND_PERIOD_S:
                self.resent_s[name] = now
                for value in list(values):
                    self.send_input(name, value)

    def carried_in(self, kind: str, name: str, opened: envelope.Envelope, header: bytes, payload: bytes) -> None:
        """A message of the cloud's replica goes to the collector, which decides."""
        del opened
        if kind == "out" and name in self.index:
            if self.bus.carry("collector", ENVELOPE, self.index[name], header, payload):
                self.counters[f"{name}.arrived"] += 1
            else:
                self.counters[f"{name}.undelivered"] += 1

    def tell(self, now: float, detailed: bool) -> None:
        """Status to control."""
        status = self.link.status()
        received = self.probe
        report = DataReported(status.connected, self.probe_age_s(now), received.incarnation if received else "")
        replicas = tuple(sorted(received.nodes.items())) if received and detailed else ()
        word = received.word if received else ""
        problems, counters = self.details(detailed)
        self.bus.send("control", DataStatus(report, None, True, status.endpoint, word, replicas, problems, counters))


def run(configuration: Configuration) -> None:
    """Entry of the process."""
    start(configuration, RobotSideData)
