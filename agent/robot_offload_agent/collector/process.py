"""The collector process: in front of the consumers of every collected output, on the robot.

Small and on its own, because the robot's output must pass also when every other process of the agent is dead. What it
has reached is kept in a small memory file, so that a collector that is started again passes nothing left behind.
"""

from __future__ import annotations

import logging
import mmap
import select
import threading
from collections import Counter
from pathlib import Path
from typing import Any

from robot_offload_agent.process import realtime
from robot_offload_agent.process.bus import ENVELOPE, PASSED, Bus, Carried, CollectorStatus, Fatal, Limits
from robot_offload_agent.process.clock import now_s, now_us
from robot_offload_agent.process.pauses import Pauses
from robot_offload_agent.ros import context, raw
from robot_offload_agent.ros.topic_loop import spin_topics
from robot_offload_agent.settings import store
from robot_offload_agent.settings.parameters import Configuration
from robot_offload_core import collectors, envelope
from robot_offload_core.collectors import Charge, Collector, Passage
from robot_offload_core.placement import SetGate
from robot_offload_core.token import Site, Token

log = logging.getLogger(__name__)

NODE_NAME = "offload_collector"
TURN_S = 0.020
"""How often is looked whether anything has changed that control must know."""
REPORTS_PER_LEASE = 3
"""Control is told this often in any case, ten times a second at least."""
DETAIL_PERIOD_S = 1.0
"""Problems and counters go to control this often; a report in between carries none."""
NAMELESS = "_NODE_NAME_UNKNOWN_"
"""What rmw calls the node of a publisher whose name has not been announced yet."""
RESOLVE_FIRST_S = 0.05
RESOLVE_PERIOD_S = 0.5
"""How often the graph is looked at: often until everything is subscribed, because no message passes before."""
SECOND_PUBLISHER_CHECK_S = 1.5
"""Discovery on one host takes up to about a second; a second publisher found by then stops the start."""
MEMORY_BYTES = 256


class Memory:
    """The charge reached so far, in a file of the runtime folder that survives the process."""

    def __init__(self, folder: Path) -> None:
        path = folder / "collector.memory"
        fresh = not path.exists()
        with path.open("a+b") as file:
            file.truncate(MEMORY_BYTES)
            self.map = mmap.mmap(file.fileno(), MEMORY_BYTES)
        if fresh:
            self.map[:] = bytes(MEMORY_BYTES)

    def save(self, state: Collector) -> None:
        """Writes who passes now."""
        if state.charge is None:
            return
        token = state.charge.token
        words = [state.charge.site.value, token.robot, str(token.epoch), token.cloud or "-"]
        line = " ".join([*words, str(state.started_us), str(int(state.fell_back)), "."]).encode()
        self.map[:] = line.ljust(MEMORY_BYTES, b"\0")

    def load(self) -> tuple[Charge, int, bool] | None:
        """(charge, started_us, fell_back), None when nothing whole is there."""
        words = self.map[:].rstrip(b"\0").decode("ascii", "replace").split(" ")
        if len(words) != 7 or words[-1] != ".":
            return None
        site, robot, epoch, cloud, started_us, fell_back, _ = words
        try:
            token = Token(robot, int(epoch), "" if cloud == "-" else cloud)
            return Charge(Site(site), token), int(started_us), bool(int(fell_back))
        except ValueError:
            return None


class CollectorProcess:
    """Joins the core's collector, raw topics and the bus. Two threads: ROS (robot's messages), bus (gate, cloud's)."""

    def __init__(self, configuration: Configuration, bus: Bus) -> None:
        self.configuration = configuration
        self.bus = bus
        self.lock = threading.Lock()
        settings = store.in_force(configuration).settings()
        self.state = collectors.start(configuration.output_specs(), settings.max_command_age_s, settings.lease_s)
        self.memory = Memory(configuration.runtime_dir)
        remembered = self.memory.load()
        if remembered is not None:
            self.state = collectors.resume(self.state, *remembered, now_s())
        self.started_s = now_s()
        self.pauses = Pauses(self.started_s)
        self.sequence = now_us()  # of the robot's messages; grows over restarts of this process
        self.detail_due_s = self.report_due_s = 0.0
        self.report_period_s = report_period_s(settings.lease_s)
        self.reported: collectors.GateReport | None = None
        self.counters: Counter[str] = Counter()
        self.problems: dict[str, tuple[str, str]] = {}
        context.init(configuration)
        self.node = context.make_node(configuration, NODE_NAME)
        self.publishers: dict[int, Any] = {}
        self.held: dict[int, bytes] = {}  # newest message per output of the side that gets ready
        self.subscriptions = [
            raw.RawSubscription(self.node, o["robot_topic"], o, False, self.robot_handler(i))
            for i, o in enumerate(configuration.outputs)
        ]

    def run(self) -> None:
        """Runs until it is ended."""
        threading.Thread(target=self.serve_bus, name="bus", daemon=True).start()
        spin_topics(self.node, self.resolve)

    # -- ROS thread ---------------------------------------------------------------------------------------------------

    def resolve(self) -> float:
        """Creates what could not be created yet and looks for second publishers; when to do so again."""
        for index, (subscription, output) in enumerate(
            zip(self.subscriptions, self.configuration.outputs, strict=True)
        ):
            subscription.resolve()
            if subscription.type_name and index not in self.publishers:
                self.add_publisher(index, subscription.type_name)
            self.note(f"robot {output.name}", subscription.problem)
        self.check_publishers()
        hurried = now_s() - self.started_s < SECOND_PUBLISHER_CHECK_S
        return RESOLVE_FIRST_S if hurried else RESOLVE_PERIOD_S

    def add_publisher(self, index: int, type_name: str) -> None:
        """The public topic of one output."""
        output = self.configuration.outputs[index]
        qos = raw.publication_qos(output, output["durability"] == "transient_local")
        self.publishers[index] = raw.make_publisher(self.node, output["topic"], type_name, qos)

    def check_publishers(self) -> None:
        """A second publisher on a public topic would bypass the gate: it stops the start, later it is a problem."""
        for output in self.configuration.outputs:
            infos = self.node.get_publishers_info_by_topic(output["topic"])
            young = now_s() - self.started_s < SECOND_PUBLISHER_CHECK_S
            others = sorted({i.node_name for i in infos if i.node_name != NODE_NAME})
            if young:
                others = [name for name in others if name != NAMELESS]  # its name is on its way
            if not others:
                self.note(f"public {output.name}", None)
                continue
            message = (
                f"{output['topic']} has another publisher: {', '.join(others)}; remap its output to "
                f"{output['robot_topic']}"
            )
            if young:
                self.bus.send("supervisor", Fatal("collector", message))
            self.note(f"public {output.name}", ("SecondPublisher", message))

    def note(self, key: str, problem: tuple[str, str] | None) -> None:
        """Keeps or clears a problem for diagnostics."""
        if problem is None:
            self.problems.pop(key, None)
        else:
            self.problems[key] = problem

    def robot_handler(self, index: int) -> raw.OnRaw:
        """For the robot's private topic of one output."""
        rated = bool(self.configuration.outputs[index]["rate_hz"])

        def handle(payload: bytes) -> None:
            if self.pauses.waited(now_s()) and rated:
                self.counters[f"{self.configuration.outputs[index].name}.robot.waited"] += 1
                return
            with self.lock:
                self.sequence += 1
                state, passage = collectors.offer_robot(self.state, index, self.sequence, now_s())
                changed = self.keep(state)
                self.publish(index, payload, passage)
            self.count("robot", index, passage)
            if changed:
                self.report()
            if passage.passes and self.configuration.outputs[index]["mirror"]:
                header = envelope.encode(envelope.Envelope(self.token(), self.sequence, 0))
                self.bus.carry("data", PASSED, index, header, payload)

        return handle

    def token(self) -> Token:
        """Under which the robot's messages go to consumers in the cloud."""
        charge = self.state.charge
        return charge.token if charge is not None else Token("", 0, "")

    def publish(self, index: int, payload: bytes, passage: Passage) -> None:
        """What the core says of a message (under the lock): publish it, or hold it for the changeover."""
        if passage.reason == "NotAllReady":
            self.held[index] = payload
        if not passage.passes:
            return
        for other in passage.also:
            if other in self.held and other in self.publishers:
                self.publishers[other].publish(self.held[other])
        if passage.reason == "ChangedOver":
            self.held.clear()
        if index in self.publishers:
            self.publishers[index].publish(payload)

    def keep(self, state: Collector) -> bool:
        """Takes over the next state (under the lock); returns whether who passes has changed, which is remembered."""
        before, self.state = self.state, state
        changed = (before.charge, before.fell_back) != (state.charge, state.fell_back)
        if changed:
            self.memory.save(state)
        return changed

    # -- bus thread ---------------------------------------------------------------------------------------------------

    def serve_bus(self) -> None:
        """Gate, cloud messages and reports."""
        due_s = now_s()
        while True:
            timeout_s = max(0.0, due_s - now_s())
            readable, _, _ = select.select([self.bus], [], [], timeout_s)
            self.pauses.waited(now_s())
            while readable and (message := self.bus.receive()) is not None:
                self.handle(message)
            if now_s() >= due_s:
                due_s = now_s() + TURN_S
                self.report(only_news=True)

    def handle(self, message: object) -> None:
        """One datagram."""
        if isinstance(message, SetGate):
            with self.lock:
                changed = self.keep(collectors.set_gate(self.state, message.gate, now_s()))
            if changed:
                self.report()
        elif isinstance(message, Carried) and message.kind == ENVELOPE:
            self.offer_cloud(message)
        elif isinstance(message, Limits):
            self.report_period_s = report_period_s(message.gate_timeout_s)
            with self.lock:
                self.state = collectors.limit(self.state, message.max_command_age_s, message.gate_timeout_s)

    def offer_cloud(self, message: Carried) -> None:
        """A message of the cloud's replica."""
        try:
            header = envelope.decode(message.header)
        except envelope.EnvelopeError:
            self.counters["cloud_garbage"] += 1
            return
        index = message.index
        if index >= len(self.subscriptions):
            self.counters["cloud_garbage"] += 1
            return
        with self.lock:
            state, passage = collectors.offer_cloud(self.state, index, header, now_s())
            changed = self.keep(state)
            self.publish(index, message.payload, passage)
        self.count("cloud", index, passage)
        if changed:
            self.report()

    def count(self, side: str, index: int, passage: Passage) -> None:
        """One counter per side and reason."""
        name = self.configuration.outputs[index].name
        self.counters[f"{name}.{side}.{'passed' if passage.passes else passage.reason}"] += 1

    def report(self, only_news: bool = False) -> None:
        """To control; also notices that control fell silent."""
        with self.lock:
            now = now_s()
            if self.keep(collectors.turn(self.state, now)):
                log.error("Control has been silent for too long, only the robot's output passes")
            report = collectors.report(self.state, now)
        if only_news and report == self.reported and now < self.report_due_s:
            return
        self.reported, self.report_due_s = report, now + self.report_period_s
        problems: tuple[tuple[str, str], ...] = ()
        counters: tuple[tuple[str, int], ...] = ()
        if now >= self.detail_due_s:
            self.detail_due_s = now + DETAIL_PERIOD_S
            problems, counters = tuple(self.problems.values()), tuple(sorted(self.counters.items()))
        self.bus.send("control", CollectorStatus(report, problems, counters))


def report_period_s(lease_s: float) -> float:
    """How often control is told in any case."""
    return min(0.1, lease_s / REPORTS_PER_LEASE)


def run(configuration: Configuration) -> None:
    """Entry of the process."""
    realtime.request(configuration["realtime"], realtime.START_PRIORITY)
    process = CollectorProcess(configuration, Bus(configuration.runtime_dir, "collector"))
    realtime.request(configuration["realtime"], realtime.DEFAULT_PRIORITY)
    process.run()
