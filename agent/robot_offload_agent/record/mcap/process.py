"""The record process: listens like any other consumer, keeps the last seconds, and writes a file for each changeover.

It is separate, so that a slow disk never reaches a process that decides or carries. Its writing thread may wait for
the disk without limit; the other one goes on listening. A failure is counted and published in `/diagnostics`, and
changes nothing else.
"""

from __future__ import annotations

import json
import logging
import os
import queue
import threading
from collections.abc import Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.serialization import deserialize_message
from std_msgs.msg import String

from robot_offload_agent.errors import StartError
from robot_offload_agent.record.mcap.kept import Kept
from robot_offload_agent.record.mcap.ring import Changeover, Entry, Ring, Window
from robot_offload_agent.record.mcap.topics import PLACEMENT, Heard
from robot_offload_agent.ros import context
from robot_offload_agent.ros.topic_loop import spin_topics
from robot_offload_agent.runtime import threads
from robot_offload_agent.runtime.beacon import Beacon
from robot_offload_agent.runtime.bus import Bus
from robot_offload_agent.runtime.clock import now_s, wall_ns
from robot_offload_agent.runtime.guard import Guard
from robot_offload_agent.runtime.release import release
from robot_offload_agent.settings.override import state_dir
from robot_offload_agent.settings.parameters import Configuration

log = logging.getLogger(__name__)

NODE_NAME = "offload_recording"
FOLDER = "recordings"
RECORD_PERIOD_S = 0.5
REPORT_S = 1.0
WAITING = 2
"""Windows that may wait for the disk; each holds its messages in memory."""
NICE = 10
"""Writing is never in a hurry."""


class RecordShell:
    """Connects the ring, the topics and the disk. Two threads: ROS, and the one that writes."""

    def __init__(self, configuration: Configuration, bus: Bus) -> None:
        self.configuration = configuration
        self.beacon = Beacon(bus, "ros")
        self.guard = Guard(context.is_up)
        self.ring = Ring(
            configuration["record.before_ms"] / 1e3, configuration["record.after_ms"] / 1e3,
            configuration["record.max_mib"] << 20,
        )  # fmt: skip
        folder = state_dir(configuration) / FOLDER
        self.kept = Kept(folder, configuration["record.keep"], release(), configuration["uid"])
        self.waiting: queue.Queue[Window] = queue.Queue(WAITING)
        self.site: str | None = None
        self.counters = {"written": 0, "failed": 0, "left_out": 0}
        self.last, self.problem = "", ""
        self.report_due_s = 0.0
        context.init(configuration)
        self.node = context.make_node(configuration, NODE_NAME)
        self.heard = Heard(self.node, configuration, self.take)
        self.diagnostics = self.node.create_publisher(DiagnosticArray, "/diagnostics", 10)

    def run(self) -> None:
        """Run until it is ended; then write what is open, as far as it goes."""
        threads.start("write", self.write_all)
        try:
            spin_topics(self.node, self.work)
        finally:
            for window in self.ring.due(float("inf")):
                self.write(window)

    def take(self, topic: str, type_name: str, latched: bool, data: bytes) -> None:
        """Take a message (ROS thread)."""
        entry = Entry(now_s(), wall_ns(), topic, type_name, data, latched)
        self.ring.add(entry)
        if topic == PLACEMENT:
            with self.guard:
                changeover = self.changed(entry)
                if changeover is not None:
                    self.ring.begin(changeover)

    def changed(self, entry: Entry) -> Changeover | None:
        """Return the changeover that a placement reports; None: the side is the same, or the first one received."""
        body = placement(entry.data)
        site, before = str(body.get("site", "")), self.site
        if site not in ("robot", "cloud"):
            return None
        self.site = site
        if before in (None, site):
            return None
        epoch = body.get("epoch")
        number = epoch if type(epoch) is int and epoch >= 0 else 0
        return Changeover(entry.at_s, entry.stamp_ns, site, number, str(body.get("reason", ""))[:128])

    def work(self) -> float:
        """Subscribe to new topics, pass windows on, report (ROS thread); return seconds until the next look."""
        self.beacon.sign("ros")
        self.heard.resolve()
        for window in self.ring.due(now_s()):
            try:
                self.waiting.put_nowait(window)
            except queue.Full:
                self.counters["left_out"] += 1
                self.fail("The disk is too slow: a recording was left out")
        if now_s() >= self.report_due_s:
            self.report_due_s = now_s() + REPORT_S
            self.publish()
        return RECORD_PERIOD_S

    def write_all(self) -> None:
        """Write what waits, repeatedly (writing thread)."""
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICE)
        while True:
            self.write(self.waiting.get())

    def write(self, window: Window) -> None:
        """Write one window."""
        try:
            file = self.kept.write(window)
        except OSError as error:
            self.counters["failed"] += 1
            self.fail(f"{self.kept.folder} cannot be written: {error.strerror}")
        except StartError as error:
            self.counters["failed"] += 1
            self.fail(str(error))
        else:
            self.counters["written"] += 1
            self.last, self.problem = str(file), ""
            log.info("Changeover recorded in %s", file)

    def fail(self, problem: str) -> None:
        """Keep a problem until a recording is written again; log each new one once."""
        if problem != self.problem:
            self.problem = problem
            log.warning("%s; the agent goes on reason=RecordingFailed", problem)

    def publish(self) -> None:
        """Publish the state of the recordings."""
        values = {**self.counters, "left_out": self.counters["left_out"] + self.ring.left_out, "last": self.last}
        status = diagnostic(self.configuration["robot_name"] or self.configuration["uid"], values, self.problem)
        array = DiagnosticArray(status=[status])
        array.header.stamp = self.node.get_clock().now().to_msg()
        self.diagnostics.publish(array)


def placement(data: bytes) -> Mapping[str, Any]:
    """Return the content of a message on the placement's topic; empty for anything else."""
    try:
        body = json.loads(deserialize_message(data, String).data)
    except (ValueError, RecursionError):
        return {}
    return body if isinstance(body, dict) else {}


def diagnostic(who: str, values: Mapping[str, object], problem: str) -> DiagnosticStatus:
    """Return the status of the recordings."""
    pairs = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
    if problem:
        pairs.append(KeyValue(key="RecordingFailed", value=problem))
    return DiagnosticStatus(
        name="robot_offload robot: record", hardware_id=who, level=DiagnosticStatus.WARN if problem else
        DiagnosticStatus.OK, message=problem or "Changeovers are recorded", values=pairs,
    )  # fmt: skip


def run(configuration: Configuration) -> None:
    """Run the process."""
    RecordShell(configuration, Bus(configuration.runtime_dir, "record")).run()
