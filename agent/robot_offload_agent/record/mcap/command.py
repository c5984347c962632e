"""`robot-offload-agent record --params FILE --output RUN.mcap`: records one robot until Ctrl-C, as one MCAP file.

With or without a running agent. It only listens.
"""

from __future__ import annotations

import argparse
import logging
import queue
import signal
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any

from robot_offload_agent.errors import AgentError, ConfigurationError, StartError
from robot_offload_agent.record.mcap.mcap_file import McapFile, library
from robot_offload_agent.record.mcap.ring import Entry
from robot_offload_agent.record.mcap.topics import Heard
from robot_offload_agent.ros import context
from robot_offload_agent.ros.topic_loop import spin_topics
from robot_offload_agent.runtime.clock import now_s, wall_ns
from robot_offload_agent.runtime.release import release
from robot_offload_agent.settings.parameters import Configuration, load
from robot_offload_core.fence.token import Site

log = logging.getLogger(__name__)

EPILOG = """\
examples:
  robot-offload-agent record --params /etc/robot-offload/wheelchair/agent.yaml --output run.mcap

The file opens in Foxglove, Lichtblick, PlotJuggler and with `ros2 bag`. exit codes: 0 ended by a signal,
2 bad configuration or no place for the file, 4 mcap is not installed, 5 the disk was full
"""
NODE_NAME = "offload_record"
SHOW_PERIOD_S = 0.25
WAITING_BYTES = 64 << 20
"""Messages that may wait for the disk; more are left out and counted."""
DISK_FULL = 5


def main(words: list[str]) -> int:
    """Run the command; return the exit code."""
    parser = argparse.ArgumentParser(
        prog="robot-offload-agent record", description=__doc__, epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("--params", type=Path, required=True, metavar="FILE", help="the robot's agent.yaml")
    parser.add_argument("--output", type=Path, required=True, metavar="RUN.mcap", help="file to write, a new one")
    options = parser.parse_args(words)
    logging.basicConfig(level="INFO", stream=sys.stderr, format="%(levelname)s record: %(message)s")
    try:
        configuration = load(options.params)
        if configuration.side is not Site.ROBOT:
            raise ConfigurationError("parameter side: record listens on robots; the file is for the cloud")
        library()
        with _new(options.output) as stream:
            return record(configuration, stream)
    except AgentError as error:
        for line in str(error).splitlines():
            sys.stderr.write(f"robot-offload-agent: {line}\n")
        return error.exit_code


def _new(file: Path) -> IO[bytes]:
    try:
        return file.open("xb")
    except OSError as error:
        raise ConfigurationError(f"--output: {file}: {error.strerror}; name a new file in a folder of yours") from error


class Stream:
    """Received messages on their way to the file. One thread passes them on, another one writes.

    Attributes:
        left_out: messages for which the disk was too slow.
        failure: why nothing is written any more.
    """

    def __init__(self, stream: IO[bytes]) -> None:
        self.left_out = 0
        self.failure = ""
        self._file = McapFile(stream, release())
        self._waiting: queue.SimpleQueue[Entry | None] = queue.SimpleQueue()
        self._bytes = 0
        self._lock = threading.Lock()
        self._writer = threading.Thread(target=self._write_all, name="write", daemon=True)
        self._writer.start()

    def take(self, topic: str, type_name: str, latched: bool, data: bytes) -> None:
        """Take a message."""
        entry = Entry(now_s(), wall_ns(), topic, type_name, data, latched)
        with self._lock:
            fits = not self.failure and self._bytes + entry.size <= WAITING_BYTES
            self._bytes += entry.size if fits else 0
        if fits:
            self._waiting.put(entry)
        else:
            self.left_out += 1

    def close(self) -> None:
        """Write what waits, and the index."""
        self._waiting.put(None)
        self._writer.join()

    def _write_all(self) -> None:
        while (entry := self._waiting.get()) is not None:
            with self._lock:
                self._bytes -= entry.size
            self._guarded(self._file.write, entry)
        self._guarded(self._file.describe, {"what": "run", "left_out": str(self.left_out)})
        self._guarded(self._file.finish)

    def _guarded(self, write: Callable[..., None], *what: Any) -> None:
        if self.failure:
            return
        try:
            write(*what)
        except (OSError, StartError) as error:
            self.failure = getattr(error, "strerror", None) or str(error)
            log.error("The recording ended: %s", self.failure)


def record(configuration: Configuration, stream: IO[bytes]) -> int:
    """Record until SIGINT or SIGTERM; return the exit code."""
    context.init(configuration)
    written = Stream(stream)
    node = context.make_node(configuration, NODE_NAME)
    heard = Heard(node, configuration, written.take)
    ended = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.set())

    def work() -> float:
        heard.resolve()
        return SHOW_PERIOD_S

    spin_topics(node, work, ended.is_set)
    written.close()
    if written.left_out:
        log.warning("%d messages were left out: the disk was too slow, or full", written.left_out)
    return DISK_FULL if written.failure else 0
