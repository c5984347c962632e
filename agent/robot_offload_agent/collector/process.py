"""The collector process: in front of the consumers of every collected output, on the robot.

It is small and separate, because the robot's output must pass even if every other process of the agent is dead. Its
state is kept in a small memory file, so that a restarted collector passes nothing that was left behind.
"""

from __future__ import annotations

import logging
import select
import threading
from typing import Any

from robot_offload_agent.collector import claims
from robot_offload_agent.errors import StartError
from robot_offload_agent.ros import context, raw
from robot_offload_agent.ros.topic_loop import spin_topics
from robot_offload_agent.runtime import losses, realtime
from robot_offload_agent.runtime.beacon import Beacon
from robot_offload_agent.runtime.bus import Bus
from robot_offload_agent.runtime.clock import now_s
from robot_offload_agent.runtime.collector_memory import Memory
from robot_offload_agent.runtime.guard import Guard
from robot_offload_agent.settings import store
from robot_offload_agent.settings.parameters import Configuration
from robot_offload_core.collector import rivals
from robot_offload_core.collector.process import CollectorPlan, CollectorProcess
from robot_offload_core.collector.state import Collector
from robot_offload_core.words.messages import Fatal, HolderChanged, Unheard

log = logging.getLogger(__name__)

NODE_NAME = "offload_collector"
RESOLVE_FIRST_S = 0.05
RESOLVE_PERIOD_S = 0.5
"""Interval of the looks at the graph; short until everything is subscribed, because no message passes before."""
MISSED_PERIOD_S = 0.1
SECOND_PUBLISHER_CHECK_S = rivals.NAME_S
"""A second publisher found by then stops the start."""


class CollectorShell:
    """Connects the core's collector process, raw topics and the bus.

    Two threads: ROS (robot's messages), bus (gate, cloud's messages).
    """

    def __init__(self, configuration: Configuration, bus: Bus) -> None:
        self.configuration = configuration
        self.bus = bus
        self.lock = threading.Lock()
        self.beacon = Beacon(bus, "ros", "bus")
        self.guard = Guard(context.is_up)
        settings = store.in_force(configuration).settings()
        self.memory = Memory(configuration.runtime_dir)
        self.has_relay = configuration.relay_plan() is not None
        plan = CollectorPlan(
            configuration.output_specs(), tuple(o["mirror"] for o in configuration.outputs),
            settings.max_command_age_s, settings.lease_s, settings.loss_timeout_s, settings.activation_deadline_s,
        )  # fmt: skip
        self.process = CollectorProcess(plan, self, self.memory.load())
        alone = [o["topic"] for o in configuration.outputs if not o["shared"]]
        self.claims = claims.claim(configuration["domain_id"], alone)
        self.started_s = now_s()
        self.missed_due_s = 0.0
        context.init(configuration)
        self.node = context.make_node(configuration, NODE_NAME)
        self.publishers: dict[int, Any] = {}
        self.offered: dict[int, Any] = {}
        self.made_s: dict[int, float] = {}
        self.published: dict[int, str] = {}  # the type, and behind a blank its hash where rmw gives one
        full_name = self.node.get_fully_qualified_name()
        self.rivals = [rivals.Rivals(full_name) for _ in configuration.outputs]
        self.twins = [rivals.Twins(full_name) for _ in configuration.outputs]
        self.subscriptions = [
            raw.RawSubscription(self.node, o["robot_topic"], o, False, self.robot_handler(i))
            for i, o in enumerate(configuration.outputs)
        ]

        self.fills: dict[int, Any] = {}
        self.shared = {
            index: raw.RawSubscription(self.node, o["topic"], o, False, self.others_handler(index))
            for index, o in enumerate(configuration.outputs)
            if index in self.process.loops
        }

    def run(self) -> None:
        """Run until it is ended."""
        threading.Thread(target=self.serve_bus, name="bus", daemon=True).start()
        spin_topics(self.node, self.resolve)

    # -- what the core's process needs --------------------------------------------------------------------------------

    def now_s(self) -> float:
        """Return the steady clock, seconds."""
        return now_s()

    def send(self, to: str, message: object) -> bool:
        """Send a message to another process of this agent."""
        return self.bus.send(to, message)

    def renew(self, to: str, message: object) -> bool:
        """Send an unchanged level to another process of this agent."""
        return self.bus.renew(to, message)

    def carry(self, to: str, kind: bytes, index: int, header: bytes, payload: Any) -> bool:
        """Send an output's message to another process of this agent."""
        output = self.configuration.outputs[index]
        return self.bus.carry(
            to, kind, index, header, payload, output["topic"], reliable=output["reliability"] != "best_effort"
        )

    def publish(self, index: int, payload: Any) -> None:
        """Publish to the consumers, once the type is known."""
        if index in self.publishers:
            self.publishers[index].publish(payload)

    def fill(self, index: int, payload: Any) -> None:
        """Publish on the private topic of a shared output's replica."""
        if index in self.fills:
            self.fills[index].publish(payload)

    def type_of(self, index: int) -> str:
        """Return the type that an output is published with; "" without a publisher."""
        return self.published.get(index, "")

    def topics_of(self, index: int) -> tuple[str, str]:
        """Return the public topic of an output and the private one of the robot's replica."""
        output = self.configuration.outputs[index]
        return output["topic"], output["robot_topic"]

    def save(self, state: Collector) -> None:
        """Store who passes now in the memory file, and wake the relay, which reads it there."""
        self.memory.save(state)
        if self.has_relay:
            self.bus.send("relay", HolderChanged())

    def fell_silent(self) -> None:
        """Log that control has been silent for too long."""
        log.error("Control has been silent for too long, only the robot's output passes")

    # -- ROS thread ---------------------------------------------------------------------------------------------------

    def resolve(self) -> float:
        """Create what could not be created yet, look for second publishers; return seconds until the next look."""
        self.beacon.sign("ros")
        for index, (subscription, output) in enumerate(
            zip(self.subscriptions, self.configuration.outputs, strict=True)
        ):
            if not output["of_cloud"]:
                subscription.resolve()
            self.resolve_publisher(index, subscription)
            self.process.note(f"robot {output.name}", subscription.problem)
        self._resolve_shared()
        self.check_publishers()
        hurried = now_s() - self.started_s < SECOND_PUBLISHER_CHECK_S
        return RESOLVE_FIRST_S if hurried else RESOLVE_PERIOD_S

    def resolve_publisher(self, index: int, subscription: raw.RawSubscription) -> None:
        """Make the publisher of the public topic, with the type and QoS of the replica's own publisher.

        Until the robot's replica has been seen, the cloud's type is taken: the robot's may be missing.
        """
        output = self.configuration.outputs[index]
        own = subscription.type_name and raw.named_type(subscription.type_name, subscription.type_hash)
        wanted = own or self.process.cloud_types.get(output.name, "")
        qos = raw.offered_qos(self.node, output, output["robot_topic"]) or self.offered.get(index)
        qos = qos or raw.publication_qos(output, output["durability"] == "transient_local")
        if not wanted or (self.published.get(index), self.offered.get(index)) == (wanted, qos):
            return
        before = self.published.get(index, "")
        if index in self.publishers and wanted.partition(" ")[0] == before and qos == self.offered[index]:
            self.published[index] = wanted  # only its hash has become known
            return
        try:
            made = raw.make_publisher(self.node, output["topic"], wanted.partition(" ")[0], qos)
        except StartError as error:
            self.process.note(f"public type {output.name}", ("TypeMissing", str(error)))
            return
        self.process.note(f"public type {output.name}", None)
        with self.lock:
            replaced = self.publishers.get(index)
            self.publishers[index], self.published[index], self.offered[index] = made, wanted, qos
            self.made_s[index] = now_s()
        if replaced is not None:
            self.node.destroy_publisher(replaced)

    def _resolve_shared(self) -> None:
        """Subscribe to the public topics of shared outputs; create the publishers of their private ones."""
        for index, heard in self.shared.items():
            heard.resolve()
            output = self.configuration.outputs[index]
            name = self.subscriptions[index].type_name or heard.type_name
            if name and index not in self.fills:
                qos = raw.publication_qos(output, output["durability"] == "transient_local")
                self.fills[index] = raw.make_publisher(self.node, output["robot_topic"], name, qos)

    def check_publishers(self) -> None:
        """Look for a second publisher on a public topic: it prevents the start, and later stops the cloud."""
        now = now_s()
        for index, output in enumerate(self.configuration.outputs):
            found = [raw.endpoint(info) for info in self.node.get_publishers_info_by_topic(output["topic"])]
            others = self.rivals[index].look(found, int(index in self.publishers), now, self.made_s.get(index, 0.0))
            with self.lock:
                message = self.process.rival(index, others)
            if message and now - self.started_s < SECOND_PUBLISHER_CHECK_S:
                self.bus.send("supervisor", Fatal("collector", message))
            private = [raw.endpoint(info) for info in self.node.get_publishers_info_by_topic(output["robot_topic"])]
            self.process.twins(index, self.twins[index].look(private, now))
            self.process.note(f"consumers {output.name}", raw.unheard(self.node, output["topic"]))

    def robot_handler(self, index: int) -> raw.OnRaw:
        """Return the callback for the robot's private topic of one output."""

        def handle(payload: bytes) -> None:
            with self.lock:
                self.process.offer_robot(index, payload)

        return handle

    def others_handler(self, index: int) -> raw.OnRaw:
        """Return the callback for the public topic of one shared output."""

        def handle(payload: bytes) -> None:
            with self.lock:
                self.process.hear_others(index, payload)

        return handle

    # -- bus thread ---------------------------------------------------------------------------------------------------

    def serve_bus(self) -> None:
        """Read the gate and the cloud's messages, and report."""
        due_s = now_s()
        while True:
            select.select([self.bus.news], [], [], max(0.0, due_s - now_s()))
            with self.lock:
                self.process.woke()
            self.beacon.sign("bus")
            while (message := self.bus.receive()) is not None:
                with self.guard, self.lock:
                    self.process.handle(message)
            with self.lock:
                self.process.counters["garbage.collector"] = self.bus.garbage + self.guard.count
                losses.report(self.bus, self.process)
                self.process.report(only_news=True)
                due_s = self.process.turn_due_s()
            self.miss_control()

    def miss_control(self) -> None:
        """Report to the supervisor, ten times a second, how long control has not been heard."""
        state, now = self.process.state, now_s()
        if state.fell_back and state.gate_s is not None and now >= self.missed_due_s:
            self.missed_due_s = now + MISSED_PERIOD_S
            self.bus.send("supervisor", Unheard("control", now - state.gate_s))


def run(configuration: Configuration) -> None:
    """Run the process."""
    realtime.request(configuration["realtime"], realtime.START_PRIORITY)
    shell = CollectorShell(configuration, Bus(configuration.runtime_dir, "collector"))
    realtime.request(configuration["realtime"], realtime.DEFAULT_PRIORITY)
    shell.run()
