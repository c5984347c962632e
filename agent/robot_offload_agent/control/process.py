"""What the control processes' shells of both sides share: one thread that decides, one that spins ROS.

Everything that happens becomes an event on the deciding thread: datagrams of the other processes, answers to service
calls, ticks. It reads all that has arrived before it ticks, so that its own delay is never taken for silence.
"""

from __future__ import annotations

import logging
import os
import queue
import secrets
import select
import sys
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

from robot_offload_agent.record import blackbox
from robot_offload_agent.ros import context
from robot_offload_agent.ros.managed_nodes import ManagedNodes
from robot_offload_agent.ros.replica_parameters import ReplicaParameters
from robot_offload_agent.ros.report import Problem, Report
from robot_offload_agent.runtime import beacon, realtime
from robot_offload_agent.runtime.bus import Bus
from robot_offload_agent.runtime.clock import now_s
from robot_offload_agent.runtime.guard import Guard
from robot_offload_agent.settings.parameters import Configuration
from robot_offload_core.control.nodes import guardians, managed_nodes
from robot_offload_core.control.process import ControlProcess
from robot_offload_core.words import beats
from robot_offload_core.words.events import Machine, Witness
from robot_offload_core.words.messages import Arrived, Fatal, Lives, Notes, PulseStatus
from robot_offload_core.words.reasons import Reason

log = logging.getLogger(__name__)

TICK_S = 0.020
"""Interval of retries and renewals; an earlier deadline is met by `next_deadline_s`."""
SLACK_S = 0.010
"""How long a due tick waits for the next datagram, so that one wake-up serves both."""
EARLY_S = 0.008
"""A tick due within this time is made with the datagram that has just arrived: both have one period."""
REPORT_PERIOD_S = 1.0
SEEN_PERIOD_S = 0.5
"""Interval at which nodes without a lifecycle are looked for in the graph."""
GRAPH_PERIOD_S = 3.0
"""Interval at which the graph is searched for what should not be there; two looks in a row must find it."""
SPINS_S = 1.0
"""Interval at which the spinning thread shows that it lives. Each time costs rclpy's executor a look at every
entity."""
SWITCH_INTERVAL_S = 0.001
"""Most frequent change of threads in the interpreter: the deciding thread must not wait 5 ms for the spinning one."""


class Witnesses:
    """Several witnesses as one."""

    def __init__(self, witnesses: list[Witness]) -> None:
        self.witnesses = tuple(witnesses)

    def stepped(self, machine: Machine, now_s: float, event: Any, after: Any, commands: Any) -> None:
        """Pass a step to each."""
        for witness in self.witnesses:
            witness.stepped(machine, now_s, event, after, commands)

    def restated(self, machine: Machine, now_s: float, state: Any) -> None:
        """Pass a state to each."""
        for witness in self.witnesses:
            witness.restated(machine, now_s, state)

    def broke(self, machine: Machine, now_s: float, event: Any, rule: str) -> None:
        """Pass a step that broke a rule to each."""
        for witness in self.witnesses:
            witness.broke(machine, now_s, event, rule)


class ControlShell(ABC):
    """Base of both sides.

    Attributes:
        process: the core's control process, set by the subclass before `run`.
        witnesses: observers of its every step besides the black box; added to before `run`.
    """

    process: ControlProcess

    def __init__(self, configuration: Configuration, bus: Bus) -> None:
        self.configuration = configuration
        self.bus = bus
        self.incarnation = secrets.token_hex(16)
        self.events: queue.SimpleQueue[Callable[[float], None]] = queue.SimpleQueue()
        self.wake = os.eventfd(0, os.EFD_NONBLOCK)
        self.pulse_status: PulseStatus | None = None
        self.lives = Lives(())
        self.guard = Guard(context.is_up)
        self.box = blackbox.of(configuration, self.incarnation)
        self.witnesses: list[Witness] = []
        self.beacon = beacon.Beacon(bus, "decide", "ros")
        self.report_due_s = self.graph_due_s = self.seen_due_s = 0.0
        context.init(configuration)
        self.report = Report(configuration)
        self.managed = ManagedNodes(configuration, self.report.guardian, self.post_guardian)
        names = self.managed.duplicated_names()
        self.comparison = ReplicaParameters(configuration, self.report.guardian, names, self.post)
        self.other_managers: tuple[Problem, ...] = ()

    def run(self) -> None:
        """Run until it is ended."""
        sys.setswitchinterval(SWITCH_INTERVAL_S)
        if self.box is not None:
            self.witnesses.append(self.box)
            self.box.start()
        if self.witnesses:
            self.process.watched_by(Witnesses(self.witnesses))
        threading.Thread(target=self._decide_to_the_end, name="decide", daemon=True).start()
        self.report.guardian.create_timer(SPINS_S, lambda: self.beacon.sign("ros"))
        try:
            context.spin(*self.report.nodes)
        finally:
            self._finish()

    def _decide_to_the_end(self) -> None:
        try:
            self.decide()
        finally:
            self._finish()

    def _finish(self) -> None:
        if self.box is not None:
            self.box.finish()

    # -- events -------------------------------------------------------------------------------------------------------

    def post(self, event: Callable[[float], None]) -> None:
        """Hand work to the deciding thread, from any thread."""
        self.events.put(event)
        os.eventfd_write(self.wake, 1)

    def post_guardian(self, event: guardians.Event) -> None:
        """Hand an observation of the guardian's shell to the deciding thread."""
        self.post(lambda _now: self.process.guard(event))

    def decide(self) -> None:
        """Take events, then a turn, repeatedly (the deciding thread)."""
        due_s = turned_s = now_s()
        while True:
            wake_s, deadline_s = due_s + SLACK_S, self.process.next_deadline_s()
            if deadline_s > turned_s:  # each once, or one that changes nothing would be met for ever
                due_s, wake_s = min(due_s, deadline_s), min(wake_s, deadline_s)
            sources: list[Any] = [self.bus.news, self.wake]
            readable, _, _ = select.select(sources, [], [], max(0.0, wake_s - now_s()))
            if self.wake in readable:
                os.eventfd_read(self.wake)
            self.drain()
            self.beacon.sign("decide")
            now = now_s()
            if now >= self.seen_due_s:
                self.seen_due_s = now + SEEN_PERIOD_S
                self.look_for_plain_nodes()
            if now >= due_s - EARLY_S:
                due_s, turned_s = now + TICK_S, now
                self.process.turn()
                self.turned(now)
                if now >= self.report_due_s:
                    self.report_due_s = now + REPORT_PERIOD_S
                    self.look_at_graph(now)
                    self.comparison.look(now)
                    self.publish_report(now)

    def drain(self) -> None:
        """Take all that has arrived."""
        while (message := self.bus.receive()) is not None:
            with self.guard:
                self.take(message)
        while True:
            try:
                event = self.events.get_nowait()
            except queue.Empty:
                return
            with self.guard:
                event(now_s())

    def take(self, message: Any) -> None:
        """Take one datagram."""
        if isinstance(message, Arrived):
            try:
                beat = beats.decode(message.text)
            except beats.BeatError:
                return
            self.process.arrived(beat, message.arrived_s, message.wall_us, message.sent)
            self.report.mirror_beat(message.text, beat)
        elif isinstance(message, Lives):
            self.take_lives(message)
        elif isinstance(message, PulseStatus):
            self.take_pulse_status(message)
        elif isinstance(message, Notes):
            self.take_notes(message, now_s())
        else:
            self.process.handle(message)

    def take_pulse_status(self, status: PulseStatus) -> None:
        """Take the state of the pulse session; what the user has to fix is a problem."""
        before, self.pulse_status = self.pulse_status, status
        if status.realtime not in ("fifo", "normal"):
            self.report.note("realtime", ("RealtimeRefused", status.realtime))
        refused = dict(status.garbage).get("BadVersion", 0) - (
            dict(before.garbage).get("BadVersion", 0) if before else 0
        )
        message = "Beats of another version arrive: install the same release of the agent on both sides"
        self.report.note("version", ("OtherVersion", message) if refused else None)

    def take_lives(self, lives: Lives) -> None:
        """Take the supervisor's report on all processes; what hung or broke is a problem for as long as it lives."""
        self.lives = lives
        hung = ", ".join(f"{name} ({hangs} times)" for name, _, hangs, _ in lives.processes if hangs)
        message = f"Did not answer any more and was started again: {hung}"
        self.report.note("hung", ("ProcessHung", message) if hung else None)
        broken = ", ".join(f"{name} ({times} times)" for name, _, _, times in lives.processes if times)
        message = f"Reached a state that must not be, ended and was started again: {broken}; the log says which"
        self.report.note("broken", ("InvariantBroken", message) if broken else None)

    def life_counters(self) -> dict[str, int]:
        """Return, for diagnostics, the number of invalid messages, and deaths of each process and their kinds."""
        counters = {"garbage.control": self.bus.garbage + self.guard.count}
        if self.box is not None and self.box.left_out:
            counters["blackbox.left_out"] = self.box.left_out
        for name, deaths, hangs, broken in self.lives.processes:
            counters |= {f"process.{name}.deaths": deaths, f"process.{name}.hangs": hangs}
            counters |= {f"process.{name}.broken": broken}
        return counters

    def look_for_plain_nodes(self) -> None:
        """Record which nodes without a lifecycle are in the graph, with all their declared names."""
        if self.managed.plain:
            missing = self.managed.missing_plain()
            self.process.guard(guardians.Seen(tuple(name for name, what in missing.items() if not what)))
            for name, what in missing.items():
                self.report.note(f"plain {name}", ("NodeUnseen", what) if what else None)

    def look_at_graph(self, now: float) -> None:
        """Report nodes that differ from their declaration, and other programs that change their states."""
        if now < self.graph_due_s:
            return
        self.graph_due_s = now + GRAPH_PERIOD_S
        for node, problem in self.managed.strange().items():
            self.report.note(f"strange {node}", problem)
        found = []
        for node, others in self.managed.other_managers().items():
            message = (
                f"{others} changes the state of {node} as well: take {node} out of its list (Nav2: `node_names` of the "
                "lifecycle manager, with `bond_timeout: 0.0`), because two managers undo each other's work"
            )
            problem = (Reason.SECOND_LIFECYCLE_MANAGER.value, message) if others else None
            self.report.note(f"manager {node}", problem)
            if problem is not None:
                found.append(problem)
                if self.configuration["strict"]:
                    self.fail_start(message)
        self.other_managers = tuple(found)

    # -- what the core's process needs --------------------------------------------------------------------------------

    def now_s(self) -> float:
        """Return the steady clock, seconds."""
        return now_s()

    def send(self, to: str, message: object) -> bool:
        """Send a message to another process of this agent."""
        if to == "pulse":
            return self.bus.renew(to, message)  # pulse reads its inbox when it speaks, nothing wakes it
        return self.bus.send(to, message)

    def renew(self, to: str, message: object) -> bool:
        """Send an unchanged level to another process of this agent."""
        return self.bus.renew(to, message)

    def carry_out(self, command: managed_nodes.Command) -> None:
        """Call a lifecycle service or the driver, or log what the guardian reports."""
        if isinstance(command, managed_nodes.NodeNews):
            log.info("Node %s: %s reason=%s", command.name, command.message, command.reason)
        else:
            self.managed.carry_out(command)

    def network_status(self, sustained: int) -> None:
        """Publish whether the link sustains the cloud."""
        self.report.publish_network_status(sustained)

    def fail_start(self, message: str) -> None:
        """End the agent with a message."""
        self.bus.send("supervisor", Fatal("control", message))

    # -- what each side does in its own way ---------------------------------------------------------------------------

    @abstractmethod
    def answer(self, key: int, accepted: bool, message: str) -> None:
        """Answer a switch by hand."""

    @abstractmethod
    def take_notes(self, message: Notes, now: float) -> None:
        """Take notes of the other side's control."""

    @abstractmethod
    def turned(self, now: float) -> None:
        """Follow each turn of the process."""

    @abstractmethod
    def publish_report(self, now: float) -> None:
        """Publish diagnostics, once a second."""


def start(configuration: Configuration, shell: type[ControlShell]) -> None:
    """Run the process."""
    started = shell(configuration, Bus(configuration.runtime_dir, "control"))
    realtime.request(configuration["realtime"], realtime.DEFAULT_PRIORITY)
    started.run()
