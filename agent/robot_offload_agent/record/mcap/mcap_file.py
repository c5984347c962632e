"""An MCAP file that Foxglove, Lichtblick, PlotJuggler and rosbag2 open: profile `ros2`, messages as received (CDR).

`mcap` is an extra (`robot-offload-agent[record]`): it is needed only to record.
"""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Mapping
from types import ModuleType
from typing import IO

from robot_offload_agent.errors import StartError
from robot_offload_agent.record.mcap.definitions import definition
from robot_offload_agent.record.mcap.ring import Entry
from robot_offload_agent.ros.interfaces import message_type

MISSING = "recording needs mcap: pip install 'robot-offload-agent[record]'"
FACTS = "robot_offload"
"""Name of the metadata record that describes the recording."""
CHUNK_BYTES = 1 << 20


def installed() -> bool:
    """Return whether recordings can be written here."""
    return importlib.util.find_spec("mcap") is not None


def library() -> ModuleType:
    """Return mcap's writer; raise StartError if it is not installed."""
    try:
        return importlib.import_module("mcap.writer")
    except ImportError as error:
        raise StartError(MISSING) from error


class McapFile:
    """Writes entries to a stream.

    Raises:
        StartError: mcap is not installed.
        OSError: in each method, what the stream raises.
    """

    def __init__(self, stream: IO[bytes], release: str) -> None:
        writer = library()
        # zstd if it is installed, as in rosbag2; a robot may have only mcap.
        packed = writer.CompressionType.ZSTD if writer.zstandard is not None else writer.CompressionType.NONE
        self._writer = writer.Writer(stream, chunk_size=CHUNK_BYTES, compression=packed)
        self._writer.start(profile="ros2", library=f"robot-offload {release}")
        self._schemas: dict[str, int] = {}
        self._channels: dict[tuple[str, str], int] = {}

    def describe(self, facts: Mapping[str, str]) -> None:
        """Write what was recorded, and why."""
        self._writer.add_metadata(FACTS, dict(facts))

    def write(self, entry: Entry) -> None:
        """Write a message; raise StartError if its type is not installed."""
        channel = self._channels.get((entry.topic, entry.type_name))
        if channel is None:
            channel = self._writer.register_channel(
                topic=entry.topic, message_encoding="cdr", schema_id=self._schema(entry.type_name),
                metadata={"offered_qos_profiles": ""},
            )  # fmt: skip
            self._channels[entry.topic, entry.type_name] = channel
        self._writer.add_message(channel, entry.stamp_ns, entry.data, entry.stamp_ns)

    def finish(self) -> None:
        """Write the index; without it readers must go through the whole file."""
        self._writer.finish()

    def _schema(self, type_name: str) -> int:
        if type_name not in self._schemas:
            text = definition(message_type(type_name), type_name)
            self._schemas[type_name] = self._writer.register_schema(
                name=type_name, encoding="ros2msg", data=text.encode()
            )
        return self._schemas[type_name]
