"""What the data processes of both sides share: link, probes, bus, diagnostics."""

from __future__ import annotations

import logging
import select
import threading
from collections import Counter
from dataclasses import replace
from typing import Any

from robot_offload_agent.data import probe
from robot_offload_agent.link.choice import LinkHandle, open_link
from robot_offload_agent.link.port import Channel
from robot_offload_agent.process import realtime
from robot_offload_agent.process.bus import Bus, Heard, Limits, Notes
from robot_offload_agent.process.clock import now_s
from robot_offload_agent.process.pauses import Pauses
from robot_offload_agent.ros import context
from robot_offload_agent.ros.topic_loop import spin_topics
from robot_offload_agent.settings.parameters import Configuration
from robot_offload_core import envelope
from robot_offload_core.placement import Reopen

log = logging.getLogger(__name__)

STATUS_PERIOD_S = 0.040
SLACK_S = 0.010
"""What is due waits so long for a datagram to come with: waking up costs more than what is done then."""
DETAIL_PERIOD_S = 1.0
UNRESOLVED_S = 0.2
RESOLVED_S = 1.0
"""How often the graph is looked at, while something is missing and otherwise."""
PROBE = Channel("probe", reliable=False, urgent=True)


def channels(configuration: Configuration) -> list[Channel]:
    """The channels of the data session; the same on both sides."""
    found = [PROBE]
    carried = configuration["link.type"] == "zenoh"
    for spec in configuration.inputs if carried else ():
        found.append(Channel(f"in/{spec.name}", reliable=spec["reliability"] != "best_effort"))
    for spec in configuration.outputs:
        found.append(Channel(f"out/{spec.name}", reliable=spec["reliability"] != "best_effort"))
        if spec["mirror"] and carried:
            found.append(Channel(f"mirror/{spec.name}", reliable=spec["reliability"] != "best_effort"))
    return found


class DataProcess:
    """Base of both sides. Three threads: ROS (main), bus, and those of the link."""

    def __init__(self, configuration: Configuration, bus: Bus) -> None:
        self.configuration = configuration
        self.bus = bus
        self.lock = threading.Lock()
        self.pauses = Pauses(now_s())
        self.heard: Heard | None = None
        self.probe: probe.Probe | None = None
        self.probe_s: float | None = None
        self.notes = ""
        self.notes_passed: tuple[str, str] = ("", "")
        self.notes_due_s = 0.0
        self.counters: Counter[str] = Counter()
        self.problems: dict[str, tuple[str, str]] = {}
        context.init(configuration)
        self.node = context.make_node(configuration, f"offload_data_{configuration['side']}")
        self.link: LinkHandle = open_link(
            configuration, "data", channels(configuration), self.on_message, node=self.node
        )
        self.carried = configuration["link.type"] == "zenoh"

    def run(self) -> None:
        """Runs until it is ended."""
        self.link.start()
        threading.Thread(target=self.serve_bus, name="bus", daemon=True).start()
        spin_topics(self.node, self.work)

    def work(self) -> float:
        """Looks at the graph; returns after how many seconds to look again."""
        return RESOLVED_S if self.resolve() else UNRESOLVED_S

    def serve_bus(self) -> None:
        """Orders in; probes and status out."""
        status_due_s = probe_due_s = detail_due_s = now_s()
        while True:
            timeout_s = max(0.0, min(status_due_s, probe_due_s) + SLACK_S - now_s())
            readable, _, _ = select.select([self.bus], [], [], timeout_s)
            self.pauses.waited(now_s())
            while readable and (message := self.bus.receive()) is not None:
                if isinstance(message, Heard):
                    self.heard = message
                elif isinstance(message, Reopen):
                    self.link.reopen(message.reason)
                elif isinstance(message, Notes):
                    self.notes = message.text
                elif isinstance(message, Limits):
                    self.limit(message)
                else:
                    self.order(message)
            now = now_s()
            if now >= probe_due_s:
                probe_due_s = now + probe.PERIOD_S
                self.link.send("probe", b"-", probe.encode(replace(self.make_probe(), notes=self.notes)))
            if now >= status_due_s:
                status_due_s = now + STATUS_PERIOD_S
                detailed = now >= detail_due_s
                detail_due_s = now + DETAIL_PERIOD_S if detailed else detail_due_s
                self.tell(now, detailed)

    def on_message(self, channel: str, header: bytes, payload: bytes) -> None:
        """From the link, on one of its threads."""
        if channel == "probe":
            try:
                received = probe.decode(payload)
            except probe.ProbeError as error:
                self.counters["garbage"] += 1
                if self.counters["garbage"] == 1:
                    log.warning("A probe that is none of ours arrived (%s), further ones are only counted", error)
                return
            if not self.knows(received.incarnation):
                self.counters["probe.foreign"] += 1
                return
            with self.lock:
                self.probe, self.probe_s = received, now_s()
            self.probed(received)
            self.pass_notes(received)
            return
        kind, _, name = channel.partition("/")
        try:
            opened = envelope.decode(header)
        except envelope.EnvelopeError:
            self.counters["garbage"] += 1
            return
        try:
            self.carried_in(kind, name, opened, header, payload)
        except Exception:
            if context.is_up():
                raise  # else this process is ending, and its publishers ended before the link

    def pass_notes(self, received: probe.Probe) -> None:
        """Notes of the other side's control to ours: at changes, and once a second because ours may be new."""
        notes, now = (received.incarnation, received.notes), now_s()
        if received.notes and (notes != self.notes_passed or now >= self.notes_due_s):
            self.notes_passed, self.notes_due_s = notes, now + DETAIL_PERIOD_S
            self.bus.send("control", Notes(*notes))

    def probe_age_s(self, now: float) -> float | None:
        """Since the other side was last heard on the data session."""
        return None if self.probe_s is None else now - self.probe_s

    def details(self, detailed: bool) -> tuple[tuple[tuple[str, str], ...], tuple[tuple[str, int], ...]]:
        """Problems and counters for a detailed status, nothing otherwise."""
        if not detailed:
            return (), ()
        return tuple(self.problems.values()), tuple(sorted(self.counters.items()))

    def note(self, key: str, problem: tuple[str, str] | None) -> None:
        """Keeps or clears a problem for diagnostics."""
        if problem is None:
            self.problems.pop(key, None)
        else:
            self.problems[key] = problem

    # -- what each side does in its own way ---------------------------------------------------------------------------

    def resolve(self) -> bool:
        """Creates subscriptions and publishers whose types have become known; whether there is nothing left to do."""
        raise NotImplementedError

    def order(self, message: Any) -> None:
        """A bus message of control or of the collector."""
        raise NotImplementedError

    def limit(self, limits: Limits) -> None:
        """Limits that control has changed."""
        raise NotImplementedError

    def make_probe(self) -> probe.Probe:
        """What this side tells in its probes."""
        raise NotImplementedError

    def knows(self, incarnation: str) -> bool:
        """Whether a probe of that incarnation of the other side is for us."""
        raise NotImplementedError

    def probed(self, received: probe.Probe) -> None:
        """A probe of the other side arrived."""
        raise NotImplementedError

    def carried_in(self, kind: str, name: str, opened: envelope.Envelope, header: bytes, payload: bytes) -> None:
        """A message of the other side arrived on channel kind/name."""
        raise NotImplementedError

    def tell(self, now: float, detailed: bool) -> None:
        """Status to control."""
        raise NotImplementedError


def start(configuration: Configuration, process: type[DataProcess]) -> None:
    """Entry of the process."""
    started = process(configuration, Bus(configuration.runtime_dir, "data"))
    realtime.request(configuration["realtime"], realtime.DEFAULT_PRIORITY)
    started.run()
