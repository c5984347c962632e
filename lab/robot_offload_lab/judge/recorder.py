"""The recorder: a consumer on the robot's side, outside the agents, that writes down what reaches the consumers.

Runs as a process of its own: `python -m robot_offload_lab.judge.recorder OUTPUT --topic /cmd_vel=TYPE ...`. Standard
input takes commands, a JSON object a line: `{"start": {run information}}`, from which moment on the recording counts,
and `{"end": steady time}`. Its end ends the recorder too. Standard output repeats each record as it comes, for a live
view, and the application's account of its drive as `{"drive": {...}}` and the link's as `{"agents": {...}}`.
"""

from __future__ import annotations

import argparse
import dataclasses
import importlib
import json
import os
import queue
import select
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Int32, String

from robot_offload_lab.judge import accounts, translate
from robot_offload_lab.judge.lines import Record
from robot_offload_lab.judge.recording import (
    LINES,
    Ending,
    Inhibit,
    NetworkStatus,
    Obstacle,
    PlacementChange,
    RecordingWriter,
    Restored,
    RunInfo,
)
from robot_offload_lab.wire.loop import steady_s
from robot_offload_lab.wire.options import LinkOptions
from robot_offload_lab.wire.schedule import Schedule

NODE_NAME = "offload_recorder"
DIAGNOSTICS = "robot_offload robot: "
ATTEND_S = 0.02
RESOLVE_S = 0.25
MEMORY_S = 2.0
_STATES = PlacementChange | NetworkStatus | Inhibit | Restored
"""Records that hold until the next of their kind; the recording begins with them."""
"""How long records are kept before the start: the command `start` comes a little later."""
LATCHED = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
OUTPUT = QoSProfile(depth=200, reliability=ReliabilityPolicy.RELIABLE)


class ConsumerRecorder:
    """Subscriptions, the recording and the live stream. One thread, and one that reads commands."""

    def __init__(
        self, path: Path, topics: dict[str, str], schedule: Schedule | None, commands: int, said: accounts.Topics
    ) -> None:
        """Subscribe to everything whose type is known already.

        Args:
            path: the recording, written from the start on.
            topics: public topics and their types; an empty type is read from the graph.
            schedule: of the emulated link, None without one.
            commands: file descriptor to read commands from.
            said: topics of the application's own accounts.
        """
        self._path = path
        self._schedule = schedule
        self._commands: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
        self._writer: RecordingWriter | None = None
        self._start_s = 0.0
        self._sampled_s = 0.0
        self._drive: translate.Drive | None = None
        self._recent: deque[tuple[float, Record]] = deque()
        self._state: dict[type, Record] = {}
        self._arrivals = {topic: translate.Arrivals(topic) for topic in topics}
        self._unresolved = dict(topics)
        self.ended = False
        self._node = rclpy.create_node(NODE_NAME)
        self._node.create_subscription(String, "/offload/placement", self._on_placement, LATCHED)
        self._node.create_subscription(Int32, "/network_status", self._on_network_status, LATCHED)
        self._node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 10)
        heard = ((said.state, self._on_drive), (said.account, self._on_account), (said.restored, self._on_restored))
        for topic, hear in heard:
            if topic:
                self._node.create_subscription(String, topic, hear, 10)
        self._resolve_timer = self._node.create_timer(RESOLVE_S, self._resolve)
        self._resolve()
        threading.Thread(target=self._read, args=(commands,), name="commands", daemon=True).start()

    def run(self) -> None:
        """Record until the command `end`."""
        executor = SingleThreadedExecutor()
        executor.add_node(self._node)
        due_s = steady_s()
        while not self.ended:
            executor.spin_once(timeout_sec=ATTEND_S)
            if steady_s() >= due_s:
                due_s = steady_s() + ATTEND_S
                self._attend()
        self._node.destroy_node()

    # -- what is heard ------------------------------------------------------------------------------------------------

    def _resolve(self) -> None:
        """Subscribe to the outputs whose types have become known."""
        for topic, declared in list(self._unresolved.items()):
            found = {info.topic_type for info in self._node.get_publishers_info_by_topic(topic)}
            name = declared or (found.pop() if len(found) == 1 else "")
            if name:
                del self._unresolved[topic]
                self._node.create_subscription(message_class(name), topic, self._hears(topic), OUTPUT)
        if not self._unresolved:
            self._resolve_timer.cancel()

    def _hears(self, topic: str) -> Callable[[Any, Any], None]:
        arrivals = self._arrivals[topic]

        def hear(message: Any, info: Any) -> None:
            t_s = arrivals.delivered_s(_received_s(info))
            header = getattr(message, "header", None)
            if header is not None:
                self._take(t_s, arrivals.stamped(t_s, header.frame_id, _made_s(header.stamp), _passed_s(info)))
            elif isinstance(message, String):
                self._take(t_s, arrivals.text(t_s, message.data))
            else:
                self._take(t_s, arrivals.other(t_s))

        return hear

    def _on_placement(self, message: String, info: Any) -> None:
        t_s = _received_s(info)
        change = translate.placement(t_s, message.data)
        if change is None:
            return
        for arrivals in self._arrivals.values():
            arrivals.acting = change.site
        self._take(t_s, change)

    def _on_network_status(self, message: Int32, info: Any) -> None:
        t_s = _received_s(info)
        self._take(t_s, NetworkStatus(t_s, "robot", message.data == 1))

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        """Take what the start waits for and the live view shows; the report has no figures from the agents."""
        found = {status.name.removeprefix(DIAGNOSTICS): status for status in message.status}
        if "link" not in found:
            return  # another program's
        measured = {pair.key: pair.value for pair in found["link"].values}
        nodes = {name[5:]: status.message for name, status in found.items() if name.startswith("node ")}
        self._tell({"agents": {"round_trip_p50_ms": measured.get("round_trip_p50_ms", ""), "nodes": nodes}})

    def _on_drive(self, message: String, info: Any) -> None:
        t_s = _received_s(info)
        drive = translate.drive(t_s, message.data)
        if drive is None:
            return
        for record in drive.records(self._drive):
            self._take(t_s, record)
        self._drive = drive
        self._tell({"drive": dataclasses.asdict(dataclasses.replace(drive, obstacles=(), walls=()))})

    def _on_account(self, message: String, info: Any) -> None:
        account = accounts.account(_received_s(info), message.data)
        for record in account.records() if account is not None else ():
            self._take(record.t_s, record)

    def _on_restored(self, message: String, info: Any) -> None:
        restored = accounts.restored(_received_s(info), message.data, _steady)
        if restored is not None:
            self._take(restored.t_s, restored)

    # -- what becomes of it -------------------------------------------------------------------------------------------

    def _take(self, t_s: float, record: Record) -> None:
        self._say(LINES.encode(record))
        if self._writer is not None:
            if t_s >= self._start_s:
                self._writer.write(record)
            return
        self._recent.append((t_s, record))
        while self._recent[0][0] < t_s - MEMORY_S:
            _, old = self._recent.popleft()
            if isinstance(old, _STATES):
                self._state[type(old)] = old

    def _tell(self, message: dict[str, Any]) -> None:
        self._say(json.dumps(message))

    @staticmethod
    def _say(line: str) -> None:
        """Send to the live view; drop what finds no room, so that the recording is never held up."""
        data = line.encode() + b"\n"
        if len(data) <= select.PIPE_BUF:  # such a write is all or nothing
            with suppress(OSError):
                os.write(sys.stdout.fileno(), data)

    # -- commands -----------------------------------------------------------------------------------------------------

    def _read(self, commands: int) -> None:
        """Read commands, in a thread of its own because reading blocks."""
        with open(commands, encoding="utf-8") as lines:
            for line in lines:
                self._commands.put(json.loads(line))
        self._commands.put({"end": None})

    def _attend(self) -> None:
        """Carry out commands, and the link's schedule up to now."""
        now_s = steady_s()
        with suppress(queue.Empty):
            while True:
                self._obey(self._commands.get_nowait())
        if self._schedule is None or self._writer is None or self.ended:
            return
        for sample in translate.link_samples(self._schedule, self._start_s, self._sampled_s, now_s):
            self._take(sample.t_s, sample)
        self._sampled_s = max(self._sampled_s, now_s)

    def _obey(self, command: dict[str, Any]) -> None:
        if "start" in command:
            lists = {name: tuple(value) for name, value in command["start"].items() if isinstance(value, list)}
            self._begin(RunInfo(**{**command["start"], **lists}))
        elif "end" in command:
            self.end(steady_s() if command["end"] is None else float(command["end"]))

    def _begin(self, run: RunInfo) -> None:
        """Open the recording: the state at the start first, then what was heard since."""
        if self._drive is not None:
            run = dataclasses.replace(
                run,
                corridor_length_m=self._drive.length_m,
                corridor_width_m=self._drive.width_m,
                walls=self._drive.walls,
            )
        self._start_s = self._sampled_s = run.start_s
        # Line-buffered and never closed: the process ends with it.
        self._writer = RecordingWriter(self._path.open("w", encoding="utf-8"), run)
        recent = list(self._recent)
        for t_s, record in recent:
            if t_s < run.start_s and isinstance(record, _STATES):
                self._state[type(record)] = record
        for record in (*self._state.values(), *(self._drive.obstacles if self._drive else ())):
            self._writer.write(record)
        for t_s, record in recent:
            if t_s >= run.start_s and not isinstance(record, Obstacle):
                self._writer.write(record)
        self._recent.clear()

    def end(self, t_s: float) -> None:
        """Close the recording with the outcome."""
        if self._writer is not None and not self.ended:
            drive = self._drive
            outcome = (drive.collisions, drive.stops, drive.goal_reached) if drive else (None, None, None)
            self._writer.write(Ending(t_s, *outcome))
        self.ended = True


def message_class(name: str) -> Any:
    """Return the class of a message type such as `geometry_msgs/msg/TwistStamped`.

    Raises:
        SystemExit: it is not installed.
    """
    package, _, short = name.partition("/msg/")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), short)
    except (ImportError, AttributeError) as error:
        raise SystemExit(f"Message type {name} cannot be imported; install the package {package}") from error


def _received_s(info: Any) -> float:
    """Return when the middleware received a message, on the steady clock: earlier than this process is scheduled."""
    return _steady(info["received_timestamp"] / 1e9)


def _passed_s(info: Any) -> float:
    """Return when a message was published, as the publisher's middleware stamped it, on the steady clock."""
    return _steady(info["source_timestamp"] / 1e9)


def _made_s(stamp: Any) -> float:
    """Return a message's stamp on the steady clock."""
    return _steady(stamp.sec + stamp.nanosec / 1e9)


def _steady(system_s: float) -> float:
    """Return a moment of this host's system clock, which stamps messages, on its steady clock."""
    return system_s - (time.clock_gettime(time.CLOCK_REALTIME) - steady_s())


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the recorder until its standard input ends, `end` comes, or SIGTERM."""
    parser = argparse.ArgumentParser(prog="python -m robot_offload_lab.judge.recorder", description=__doc__)
    parser.add_argument("output", type=Path, help="the recording to write")
    parser.add_argument("--topic", action="append", default=[], metavar="TOPIC=TYPE", help="an output; TYPE or nothing")
    parser.add_argument("--state", default="", metavar="TOPIC", help="topic of the application's account of its drive")
    parser.add_argument("--account", default="", metavar="TOPIC", help="topic of a client's account of goals and calls")
    parser.add_argument("--restored", default="", metavar="TOPIC", help="topic of a node's account of its state")
    parser.add_argument("--link", default="", metavar="JSON", help="options of the emulated link")
    options = parser.parse_args(arguments)
    topics = dict(text.partition("=")[::2] for text in options.topic)
    schedule = LinkOptions.from_dict(json.loads(options.link)).schedule() if options.link else None
    os.set_blocking(sys.stdout.fileno(), False)
    # Own handlers: with rclpy's the context can vanish during a callback.
    rclpy.init(args=[], signal_handler_options=rclpy.SignalHandlerOptions.NO)
    said = accounts.Topics(state=options.state, account=options.account, restored=options.restored)
    recorder = ConsumerRecorder(options.output, topics, schedule, sys.stdin.fileno(), said)
    signal.signal(signal.SIGTERM, lambda *_: recorder.end(steady_s()))
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    recorder.run()
    rclpy.shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
