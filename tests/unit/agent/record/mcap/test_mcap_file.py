"""A recording is read back by libraries of others: bytes as they came, types described so that they can be read."""

from io import BytesIO
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from mcap.reader import make_reader
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message
from rosbags.highlevel import AnyReader
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Empty, String
from test_msgs.msg import Arrays, Constants, Nested

from robot_offload_agent.record.mcap.definitions import definition
from robot_offload_agent.record.mcap.mcap_file import McapFile
from robot_offload_agent.record.mcap.ring import Entry
from robot_offload_agent.ros.interfaces import message_type

ACTIONS = {
    name: message_type(name)
    for name in ("test_msgs/action/Fibonacci_FeedbackMessage", "test_msgs/action/Fibonacci_GetResult_Event")
}
KINDS: tuple[type[Any], ...] = (
    String, DiagnosticArray, Odometry, PointCloud2, Arrays, Constants, Empty, Nested, *ACTIONS.values(),
)  # fmt: skip


def name_of(kind: type[Any]) -> str:
    if kind in ACTIONS.values():
        return next(name for name, one in ACTIONS.items() if one is kind)
    return f"{kind.__module__.split('.')[0]}/msg/{kind.__name__}"


def entry(message: Any, at_ns: int = 5, topic: str = "/topic") -> Entry:
    return Entry(at_ns / 1e9, at_ns, topic, name_of(type(message)), serialize_message(message))


def written(path: Path, *entries: Entry) -> Path:
    with path.open("wb") as stream:
        file = McapFile(stream, "1.2.3")
        file.describe({"what": "test"})
        for each in entries:
            file.write(each)
        file.finish()
    return path


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_every_type_is_read_back_by_a_library_that_knows_it_only_from_the_file(kind: type[Any], tmp_path: Path) -> None:
    path = written(tmp_path / "run.mcap", entry(kind()))
    with AnyReader([path]) as bag:
        [(connection, at_ns, raw)] = bag.messages()
        assert (connection.topic, connection.msgtype, at_ns) == ("/topic", name_of(kind), 5)
        read = bag.deserialize(raw, connection.msgtype)
        fields = kind.get_fields_and_field_types()
        assert set(fields) <= set(vars(read))


def test_values_and_bytes_are_those_that_were_sent(tmp_path: Path) -> None:
    status = DiagnosticStatus(level=DiagnosticStatus.WARN, name="a", values=[KeyValue(key="k", value="ü")])
    sent = entry(DiagnosticArray(status=[status]))
    path = written(tmp_path / "run.mcap", sent)
    with AnyReader([path]) as bag:
        [(connection, _, raw)] = bag.messages()
        assert bytes(raw) == sent.data
        read: Any = bag.deserialize(raw, connection.msgtype)
        assert (read.status[0].level, read.status[0].values[0].value) == (1, "ü")


def test_the_file_has_an_index_and_says_who_wrote_it(tmp_path: Path) -> None:
    path = written(tmp_path / "run.mcap", entry(String(data="x")), entry(Empty(), 9, "/other"))
    with path.open("rb") as stream:
        reader = make_reader(stream)
        header, summary = reader.get_header(), reader.get_summary()
        assert (header.profile, header.library) == ("ros2", "robot-offload 1.2.3")
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == 2
        assert {channel.message_encoding for channel in summary.channels.values()} == {"cdr"}
        assert {schema.encoding for schema in summary.schemas.values()} == {"ros2msg"}
        assert [each.metadata for each in reader.iter_metadata()] == [{"what": "test"}]


def test_a_message_of_16_mib_goes_in_as_it_is(tmp_path: Path) -> None:
    sent = entry(String(data="a" * (16 << 20)))
    path = written(tmp_path / "run.mcap", sent)
    with path.open("rb") as stream:
        [(_, _, message)] = make_reader(stream).iter_messages()
        assert message.data == sent.data


def test_one_topic_may_change_its_type(tmp_path: Path) -> None:
    path = written(tmp_path / "run.mcap", entry(String(data="x")), entry(Empty(), 9))
    with path.open("rb") as stream:
        read = [(schema.name, channel.topic) for schema, channel, _ in make_reader(stream).iter_messages() if schema]
        assert read == [("std_msgs/msg/String", "/topic"), ("std_msgs/msg/Empty", "/topic")]


def test_a_definition_names_each_type_within_once() -> None:
    text = definition(Odometry, "nav_msgs/msg/Odometry")
    parts = [line for line in text.splitlines() if line.startswith("MSG: ")]
    assert "MSG: geometry_msgs/Vector3" in parts
    assert len(parts) == len(set(parts))
    assert "float64[36] covariance" in text.splitlines()


def test_a_stream_that_fails_is_an_os_error() -> None:
    class Full(BytesIO):
        def write(self, data: Any) -> int:
            raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match="No space left"):
        McapFile(Full(), "1.2.3").finish()
