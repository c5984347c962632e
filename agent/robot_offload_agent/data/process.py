"""What the data processes' shells of both sides share: link, bus, threads."""

from __future__ import annotations

import logging
import select
import threading
from abc import ABC, abstractmethod
from typing import Any

from robot_offload_agent.data.states import StateTopics, carried_states
from robot_offload_agent.link.choice import LinkHandle, open_link
from robot_offload_agent.link.port import Channel
from robot_offload_agent.ros import context
from robot_offload_agent.ros.topic_loop import spin_topics
from robot_offload_agent.runtime import losses, realtime
from robot_offload_agent.runtime.beacon import Beacon
from robot_offload_agent.runtime.bus import Bus
from robot_offload_agent.runtime.clock import now_s, wall_ns
from robot_offload_agent.runtime.guard import Guard
from robot_offload_agent.runtime.heard_memory import HeardView
from robot_offload_agent.settings.parameters import Configuration
from robot_offload_core.data.process import RELAY, REPORT, DataPlan, DataProcess, InputPlan, OutputPlan
from robot_offload_core.data.states import CHANNEL
from robot_offload_core.words.declared import Priority

log = logging.getLogger(__name__)

SLACK_S = 0.010
"""How long due work waits for a datagram to be done with: waking up costs more than the work."""
UNRESOLVED_S = 0.2
RESOLVED_S = 1.0
"""Intervals of the looks at the graph: while something is missing, and otherwise."""
CARRYING = ("in", "out")
"""Kinds of channels that carry a topic from one side to the other."""
PROBE = Channel("probe", reliable=False, urgent=True)
LETTERS = Channel(RELAY)
NUMBERS = Channel(REPORT, reliable=False, priority=Priority.LOW)


def channels(configuration: Configuration) -> list[Channel]:
    """Return the channels of the data session; the same on both sides."""
    found = [PROBE, NUMBERS]
    carried = configuration["link.type"] == "zenoh"
    for spec in configuration.inputs if carried else ():
        found.append(
            Channel(
                f"in/{spec.name}", reliable=spec["reliability"] != "best_effort", priority=Priority(spec["priority"]),
                latest=spec["latest"],
            )
        )  # fmt: skip
    for spec in configuration.outputs:
        found.append(Channel(f"out/{spec.name}", reliable=spec["reliability"] != "best_effort"))
        for kind, wanted in (("mirror", spec["mirror"]), ("others", spec["shared"])):
            if wanted and carried:
                found.append(Channel(f"{kind}/{spec.name}", reliable=spec["reliability"] != "best_effort"))
    if configuration.relay_plan() is not None:
        found.append(LETTERS)
    found += [Channel(f"{CHANNEL}{name}") for name in carried_states(configuration)]
    return found


def plan(configuration: Configuration, rates_hz: dict[str, float]) -> DataPlan:
    """Return the part of the configuration that the core's data process needs; `rates_hz`: in force for each input."""
    return DataPlan(
        tuple(
            InputPlan(
                i.name,
                i["max_age_ms"],
                rates_hz.get(i.name, 0.0),
                i["latched"],
                i["min_rate_hz"],
                Priority(i["priority"]),
                i["latest"],
                i["topic"],
            )
            for i in configuration.inputs
        ),
        tuple(
            OutputPlan(spec.name, spec.deadline_s, o["mirror"], o["of_cloud"], spec)
            for spec, o in zip(configuration.output_specs(), configuration.outputs, strict=True)
        ),
        carried=configuration["link.type"] == "zenoh",
        max_message_size=configuration["max_message_size"],
    )


class DataShell(ABC):
    """Base of both sides. Three threads: ROS (main), bus, and those of the link.

    Attributes:
        process: the core's data process, set by the subclass before `run`.
    """

    process: DataProcess

    def __init__(self, configuration: Configuration, bus: Bus) -> None:
        self.configuration = configuration
        self.bus = bus
        self.lock = threading.Lock()
        self.beacon = Beacon(bus, "ros", "bus")
        self.guard = Guard(context.is_up)
        context.init(configuration)
        self.node = context.make_node(configuration, f"offload_data_{configuration['side']}")
        self.link: LinkHandle = open_link(
            configuration, "data", channels(configuration), self.on_message, self.node, self.on_room
        )
        self.carried = configuration["link.type"] == "zenoh"
        self.states: StateTopics | None = None
        self.heard = HeardView(bus.folder)

    def run(self) -> None:
        """Run until it is ended."""
        if carried_states(self.configuration):
            self.states = StateTopics(self.configuration, self.node, self.process)
        self.link.start()
        threading.Thread(target=self.serve_bus, name="bus", daemon=True).start()
        spin_topics(self.node, self.work)

    def work(self) -> float:
        """Look at the graph; return after how many seconds to look again."""
        self.beacon.sign("ros")
        resolved = self.resolve()
        if self.states is not None:
            resolved = self.states.resolve() and resolved
        return RESOLVED_S if resolved else UNRESOLVED_S

    def serve_bus(self) -> None:
        """Read orders; send probes and report."""
        while True:
            timeout_s = max(0.0, self.process.due_s + SLACK_S - now_s())
            select.select([self.bus.news], [], [], timeout_s)
            self.process.woke()
            self.beacon.sign("bus")
            while (message := self.bus.receive()) is not None:
                with self.guard:
                    self.process.handle(message)
            self.look_who_is_heard()
            self.process.counters["garbage.data"] = self.bus.garbage + self.guard.count
            losses.report(self.bus, self.process)
            self.process.turn()
            if self.states is not None:
                self.states.process.turn()

    def look_who_is_heard(self) -> None:
        """Take the partner's newest beat, for what is sent next."""
        news = self.heard.news()
        if news is not None:
            self.process.handle(news)

    def on_message(self, channel: str, header: bytes, payload: bytes) -> None:
        """Take a message from the link, on one of its threads; count the bytes of each topic."""
        kind, _, name = channel.partition("/")
        if kind in CARRYING:
            self.process.counters[f"{name}.bytes"] += len(payload)
        with self.guard:
            if self.states is not None and channel.startswith(CHANNEL):
                self.states.process.arrived(channel.removeprefix(CHANNEL), header, payload)
            else:
                self.process.arrived(channel, header, payload)

    # -- what the core's process needs --------------------------------------------------------------------------------

    def now_s(self) -> float:
        """Return the steady clock, seconds."""
        return now_s()

    def system_s(self) -> float:
        """Return the system clock, seconds."""
        return wall_ns() / 1e9

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

    def cross(self, channel: str, header: bytes, payload: Any) -> bool:
        """Send over the link; count the bytes of each topic."""
        sent = self.link.send(channel, header, payload)
        name = channel.partition("/")[2]
        if sent and name:
            self.process.counters[f"{name}.bytes"] += len(payload)
        return sent

    def link_status(self) -> tuple[bool, str]:
        """Return whether the data session is connected, and its endpoint."""
        status = self.link.status()
        return status.connected, status.endpoint

    def reopen(self, reason: str) -> None:
        """Drop the data session and open a new one."""
        self.link.reopen(reason)

    def warn(self, message: str) -> None:
        """Log a warning."""
        log.warning("%s", message)

    # -- what each side does in its own way ---------------------------------------------------------------------------

    @abstractmethod
    def resolve(self) -> bool:
        """Create subscriptions and publishers whose types are known; return whether nothing is left to do."""

    @abstractmethod
    def on_room(self, channel: str) -> None:
        """Take the news, on a thread of the link, that a channel has room again."""

    @abstractmethod
    def types(self) -> dict[str, str]:
        """Return the interface types that this side has found in the graph."""


def start(configuration: Configuration, shell: type[DataShell]) -> None:
    """Run the process."""
    started = shell(configuration, Bus(configuration.runtime_dir, "data"))
    realtime.request(configuration["realtime"], realtime.DEFAULT_PRIORITY)
    started.run()
