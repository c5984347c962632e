"""The cloud's data process: inputs to the replicas, and the egress, where every output is checked against the lease."""

from __future__ import annotations

from collections import defaultdict
from functools import partial
from typing import Any

from robot_offload_agent.data import probe
from robot_offload_agent.data.process import DataProcess, start
from robot_offload_agent.errors import StartError
from robot_offload_agent.process.bus import Bus, DataStatus, Egress, Limits
from robot_offload_agent.process.clock import now_s
from robot_offload_agent.ros import raw
from robot_offload_agent.settings.parameters import Configuration, Named
from robot_offload_core import envelope
from robot_offload_core.lease import CloudData, SetEgress
from robot_offload_core.token import Token

CLOSED = Egress("", "", SetEgress(None, 0.0))


class CloudSideData(DataProcess):
    """See the module."""

    def __init__(self, configuration: Configuration, bus: Bus) -> None:
        super().__init__(configuration, bus)
        self.egress = CLOSED
        self.sequence: dict[tuple[str, Token], int] = defaultdict(int)
        self.types: dict[str, str] = {i.name: i["type"] for i in configuration.inputs if i["type"] != "auto"}
        self.required = [i for i in configuration.inputs if i["max_age_ms"] > 0]
        self.accepted: dict[str, tuple[float, float]] = {}  # input -> (arrival, bound of its age then)
        self.latched: dict[str, list[bytes]] = {i.name: [] for i in configuration.inputs if i["latched"]}
        self.wanted: dict[str, str] = {}  # latched input -> hash that the robot holds
        self.publishers: dict[str, Any] = {}
        self.inputs = {i.name: i for i in configuration.inputs}
        self.max_age_ms = {i.name: i["max_age_ms"] for i in configuration.inputs}
        self.outputs = [
            raw.RawSubscription(self.node, o["cloud_topic"], o, False, partial(self.leave, o))
            for o in configuration.outputs
        ]
        self.watched = [
            raw.RawSubscription(self.node, i["topic"], i, i["latched"], partial(self.watch, i.name))
            for i in (() if self.carried else self.required)
        ]

    # -- towards the robot --------------------------------------------------------------------------------------------

    def leave(self, output: Named, payload: bytes) -> None:
        """The egress: a message of a replica leaves only under a valid lease, read at this very moment."""
        if self.pauses.waited(now_s()) and output["rate_hz"]:
            self.counters[f"{output.name}.waited"] += 1
            return
        egress = self.egress.egress
        heard = self.heard
        if egress.token is None or now_s() >= egress.lease_end_s:
            self.counters[f"{output.name}.held_back"] += 1
            return
        echo_us = heard.sent_us if heard and heard.incarnation == egress.token.robot else 0
        key = (output.name, egress.token)
        if key not in self.sequence:
            for old in [k for k in self.sequence if k[0] == output.name]:
                del self.sequence[old]
        self.sequence[key] += 1
        header = envelope.encode(envelope.Envelope(egress.token, self.sequence[key], echo_us))
        if now_s() >= egress.lease_end_s:  # stopped between the first look and here
            self.counters[f"{output.name}.held_back"] += 1
            return
        sent = self.link.send(f"out/{output.name}", header, payload)
        self.counters[f"{output.name}.{'sent' if sent else 'unsent'}"] += 1
        if output["mirror"] and self.carried:
            self.publish_output(output, payload)

    def publish_output(self, output: Named, payload: bytes) -> None:
        """To consumers in the cloud."""
        key = f"public {output.name}"
        if key not in self.publishers:
            name = next(s.type_name for s in self.outputs if s.spec is output) or self.types.get(output.name, "")
            if not name:
                return
            qos = raw.publication_qos(output, output["durability"] == "transient_local")
            self.publishers[key] = raw.make_publisher(self.node, output["topic"], name, qos)
        self.publishers[key].publish(payload)

    # -- from the robot -----------------------------------------------------------------------------------------------

    def carried_in(self, kind: str, name: str, opened: envelope.Envelope, header: bytes, payload: bytes) -> None:
        """An input, or what has passed at the robot's collector."""
        del header
        if opened.token.robot != self.egress.robot or not opened.token.robot:
            self.counters[f"{name}.foreign"] += 1
            return
        if kind == "mirror":
            output = next((o for o in self.configuration.outputs if o.name == name), None)
            if output is not None:
                self.publish_output(output, payload)
            return
        spec = self.inputs.get(name)
        if kind != "in" or spec is None:
            return
        now = now_s()
        known = opened.token.cloud == self.egress.incarnation  # else the echo is of another host's clock
        age_s = opened.age_s(now) if known else float("inf")
        if self.max_age_ms[name] and age_s * 1e3 > self.max_age_ms[name]:
            self.counters[f"{name}.too_old"] += 1
            return
        with self.lock:
            self.accepted[name] = (now, age_s)
            if name in self.latched:
                self.keep_latched(name, payload)
        self.publish_input(spec, payload)

    def keep_latched(self, name: str, payload: bytes) -> None:
        """Keeps the values that make up the robot's hash: the newest ones, as many as give it."""
        values = [v for v in self.latched[name] if v != payload] + [payload]
        target = self.wanted.get(name, "")
        for start_at in range(len(values)):
            if probe.digest(values[start_at:]) == target:
                values = values[start_at:]
                break
        self.latched[name] = values[-32:]

    def publish_input(self, spec: Named, payload: bytes) -> None:
        """To the replicas."""
        publisher = self.publishers.get(spec.name)
        if publisher is None:
            self.counters[f"{spec.name}.no_type"] += 1
            return
        publisher.publish(payload)
        self.counters[f"{spec.name}.published"] += 1

    def watch(self, name: str, payload: bytes) -> None:
        """On DDS transports inputs arrive by themselves; only their silence can be judged."""
        del payload
        self.accepted[name] = (now_s(), 0.0)

    # -- levels -------------------------------------------------------------------------------------------------------

    def resolve(self) -> bool:
        """Publishers of inputs whose type is known, subscriptions to outputs that are published."""
        resolved = []
        for subscription in [*self.outputs, *self.watched]:
            resolved.append(subscription.resolve())
            self.note(f"output {subscription.spec.name}", subscription.problem)
        for name, spec in self.inputs.items() if self.carried else ():
            if name in self.publishers or name not in self.types:
                continue
            try:
                publisher = raw.make_publisher(
                    self.node, spec["topic"], self.types[name], raw.publication_qos(spec, spec["latched"])
                )
            except StartError as error:
                self.note(f"input {name}", ("TypeMissing", str(error)))
                continue
            for value in self.latched.get(name, ()):
                publisher.publish(value)
            self.publishers[name] = publisher
        return all(resolved) and (not self.carried or self.publishers.keys() >= self.inputs.keys())

    def order(self, message: object) -> None:
        """The lease from control."""
        if isinstance(message, Egress):
            self.egress = message

    def limit(self, limits: Limits) -> None:
        """The oldest age of each input."""
        self.max_age_ms.update({name: age_ms for name, age_ms, _ in limits.inputs})

    def make_probe(self) -> probe.Probe:
        """Identity, hashes held, node states."""
        with self.lock:
            latched = {name: probe.digest(values) for name, values in self.latched.items() if values}
        types = {s.spec.name: s.type_name for s in self.outputs if s.type_name}
        return probe.Probe(self.egress.incarnation, latched, types, dict(self.egress.nodes), self.egress.word)

    def knows(self, incarnation: str) -> bool:
        """Only the robot served: a second one of the same identity must not disturb the first."""
        return bool(incarnation) and incarnation == self.egress.robot

    def probed(self, received: probe.Probe) -> None:
        """Types and wanted hashes from the robot."""
        self.wanted = received.latched
        for name, type_name in received.types.items():
            self.types.setdefault(name, type_name)

    def complete(self) -> bool:
        """The latched inputs are the robot's."""
        return all(self.latched.get(n) and probe.digest(self.latched[n]) == h for n, h in self.wanted.items())

    def tell(self, now: float, detailed: bool) -> None:
        """Status to control."""
        status = self.link.status()
        ages = tuple(
            None if i.name not in self.accepted else now - self.accepted[i.name][0] + self.accepted[i.name][1]
            for i in self.required
        )
        data = CloudData(self.probe_age_s(now), ages)
        problems, counters = self.details(detailed)
        with self.lock:
            complete = self.complete()
        word = self.probe.word if self.probe else ""
        self.bus.send("control", DataStatus(None, data, complete, status.endpoint, word, (), problems, counters))


def run(configuration: Configuration) -> None:
    """Entry of the process."""
    start(configuration, CloudSideData)
