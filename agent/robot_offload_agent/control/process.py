"""What the control processes of both sides share: one thread that decides, one that spins ROS.

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

from robot_offload_agent.process import realtime
from robot_offload_agent.process.bus import Arrived, Bus, Fatal, PulseStatus
from robot_offload_agent.process.clock import now_s, now_us
from robot_offload_agent.ros import context
from robot_offload_agent.ros.managed_nodes import ManagedNodes
from robot_offload_agent.ros.report import Report
from robot_offload_agent.settings.parameters import Configuration
from robot_offload_core import beats, guardians
from robot_offload_core.events import Tick
from robot_offload_core.token import Site

log = logging.getLogger(__name__)

TICK_S = 0.020
"""The clockwork of retries and renewals; a deadline that matters sooner is met by `next_deadline_s`."""
SLACK_S = 0.010
"""A tick that is due waits so long for a datagram to come with: waking up costs more than what is done then."""
REPORT_PERIOD_S = 1.0
SWITCH_INTERVAL_S = 0.001
"""The interpreter changes threads this often at most: the deciding thread must not wait 5 ms for the spinning one."""


class ControlProcess(ABC):
    """Base of both sides."""

    def __init__(self, configuration: Configuration, bus: Bus) -> None:
        self.configuration = configuration
        self.bus = bus
        self.incarnation = secrets.token_hex(16)
        self.started_us = now_us()
        self.settings = configuration.settings()
        self.events: queue.SimpleQueue[Callable[[float], None]] = queue.SimpleQueue()
        self.wake = os.eventfd(0, os.EFD_NONBLOCK)
        self.pulse_status: PulseStatus | None = None
        self.report_due_s = 0.0
        context.init(configuration)
        self.report = Report(configuration)
        has_driver = configuration.side is Site.ROBOT and bool(configuration["inhibit_service"])
        self.guardian = guardians.start(configuration.node_specs(), self.settings.activation_deadline_s, has_driver)
        self.managed = ManagedNodes(configuration, self.report.guardian, self.post_guardian)

    def run(self) -> None:
        """Runs until it is ended."""
        sys.setswitchinterval(SWITCH_INTERVAL_S)
        threading.Thread(target=self.decide, name="decide", daemon=True).start()
        context.spin(*self.report.nodes)

    # -- events -------------------------------------------------------------------------------------------------------

    def post(self, event: Callable[[float], None]) -> None:
        """Hands work to the deciding thread, from any thread."""
        self.events.put(event)
        os.eventfd_write(self.wake, 1)

    def post_guardian(self, event: guardians.Event) -> None:
        """An observation of the guardian's shell."""
        self.post(lambda now: self.step_guardian(event, now))

    def decide(self) -> None:
        """The deciding thread: events, then a tick, over and over."""
        due_s = ticked_s = now_s()
        sources: list[Any] = [self.bus, self.wake]
        while True:
            wake_s, deadline_s = due_s + SLACK_S, self.next_deadline_s()
            if deadline_s > ticked_s:  # each once, or one that changes nothing would be ticked for ever
                due_s, wake_s = min(due_s, deadline_s), min(wake_s, deadline_s)
            readable, _, _ = select.select(sources, [], [], max(0.0, wake_s - now_s()))
            if self.wake in readable:
                os.eventfd_read(self.wake)
            self.drain()
            now = now_s()
            if now >= due_s:
                due_s, ticked_s = now + TICK_S, now
                self.tick(now)
                self.step_guardian(Tick(), now)
                if now >= self.report_due_s:
                    self.report_due_s = now + REPORT_PERIOD_S
                    self.publish_report(now)

    def drain(self) -> None:
        """All that has arrived."""
        while (message := self.bus.receive()) is not None:
            self.take(message)
        while True:
            try:
                event = self.events.get_nowait()
            except queue.Empty:
                return
            event(now_s())

    def take(self, message: Any) -> None:
        """One datagram."""
        if isinstance(message, Arrived):
            try:
                beat = beats.decode(message.text)
            except beats.BeatError:
                return
            if message.sent is not None:
                self.take_message(message.sent)
            self.take_beat(beat, message)
            self.report.mirror_beat(message.text, beat)
        elif isinstance(message, PulseStatus):
            self.pulse_status = message
            if message.realtime not in ("fifo", "normal"):
                self.report.note("realtime", ("RealtimeRefused", message.realtime))
        else:
            self.take_message(message)

    # -- the guardian -------------------------------------------------------------------------------------------------

    def step_guardian(self, event: guardians.Event, now: float) -> None:
        """Steps the guardian core and carries out its commands."""
        ready = guardians.is_ready(self.guardian)
        self.guardian, commands = guardians.step(self.guardian, event, now)
        for command in commands:
            if isinstance(command, guardians.NodeNews):
                log.info("Node %s: %s reason=%s", command.name, command.message, command.reason)
            else:
                self.managed.carry_out(command)
        if guardians.is_ready(self.guardian) is not ready:
            self.nodes_changed(now)

    def node_states(self) -> tuple[tuple[str, str], ...]:
        """(node, lifecycle state) of this side."""
        return tuple((n.spec.name, n.state.value) for n in self.guardian.nodes if n.spec.lifecycle)

    def fail_start(self, message: str) -> None:
        """Ends the agent with a message."""
        self.bus.send("supervisor", Fatal("control", message))

    def next_deadline_s(self) -> float:
        """When a tick is worth more than at the next period; infinite when there is nothing to wait for."""
        return float("inf")

    # -- what each side does in its own way ---------------------------------------------------------------------------

    @abstractmethod
    def take_beat(self, beat: beats.Beat, arrived: Arrived) -> None:
        """A beat of the other side."""

    @abstractmethod
    def take_message(self, message: Any) -> None:
        """Any other datagram."""

    @abstractmethod
    def tick(self, now: float) -> None:
        """Time has passed."""

    @abstractmethod
    def nodes_changed(self, now: float) -> None:
        """Readiness of this side's nodes changed."""

    @abstractmethod
    def publish_report(self, now: float) -> None:
        """Diagnostics, once a second."""


def start(configuration: Configuration, process: type[ControlProcess]) -> None:
    """Entry of the process."""
    started = process(configuration, Bus(configuration.runtime_dir, "control"))
    realtime.request(configuration["realtime"], realtime.DEFAULT_PRIORITY)
    started.run()
