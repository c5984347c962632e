"""The link over DDS topics: its codec, and two ends in one real ROS domain."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from operator import eq
from typing import Any

import pytest
import rclpy
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Header, UInt8MultiArray

from robot_offload_agent.errors import ConfigurationError
from robot_offload_agent.link import ros
from robot_offload_agent.link.port import Channel
from robot_offload_agent.link.ros import MalformedError, RosLink

pytestmark = [pytest.mark.ros, pytest.mark.core]

DOMAIN_ID = 41
CHANNELS = [Channel("beat", reliable=False, urgent=True), Channel("probe", reliable=False), Channel("out/cmd_vel")]
PATIENCE_S = 60.0


# -- codec ------------------------------------------------------------------------------------------------------------


@settings(deadline=None)  # a busy machine is no failure
@given(st.binary(max_size=200), st.binary(max_size=5000))
def test_a_frame_comes_back_as_it_was(header: bytes, payload: bytes) -> None:
    assert ros.decode_frame(ros.encode_frame(header, payload)) == (header, payload)


@settings(deadline=None)  # a busy machine is no failure
@given(st.binary(max_size=50), st.binary(max_size=50))
def test_a_frame_is_what_ros_itself_would_write(header: bytes, payload: bytes) -> None:
    message = UInt8MultiArray(data=len(header).to_bytes(2, "big") + header + payload)
    assert ros.decode_frame(serialize_message(message)) == (header, payload)
    read = deserialize_message(ros.encode_frame(header, payload), UInt8MultiArray)
    assert bytes(read.data) == bytes(message.data)


@settings(deadline=None)  # a busy machine is no failure
@given(st.integers(0, 2**31 * 10**9 - 1), st.text(st.characters(exclude_characters="\0", codec="utf-8")))
def test_a_beat_is_a_header_with_the_text_in_frame_id(stamp_ns: int, text: str) -> None:
    encoded = ros.encode_beat(stamp_ns, text.encode())
    assert ros.decode_beat(encoded) == text.encode()
    read = deserialize_message(encoded, Header)
    assert read.frame_id == text
    assert read.stamp.sec * 10**9 + read.stamp.nanosec == stamp_ns
    assert ros.decode_beat(serialize_message(Header(frame_id=text))) == text.encode()


@settings(deadline=None)  # a busy machine is no failure
@given(st.binary(max_size=100), st.sampled_from([b"", b"\x00\x01\x00\x00", b"\x00\x00\x00\x00"]))
def test_garbage_is_refused_in_one_way_only(data: bytes, prefix: bytes) -> None:
    for decode in (ros.decode_frame, ros.decode_beat):
        try:
            decode(prefix + data)
        except MalformedError:
            continue


@settings(deadline=None)  # a busy machine is no failure
@given(st.binary(max_size=100), st.binary(max_size=100), st.data())
def test_a_cut_frame_is_refused(header: bytes, payload: bytes, data: st.DataObject) -> None:
    whole = ros.encode_frame(header, payload)
    cut = data.draw(st.integers(0, len(whole) - 1))
    with pytest.raises(MalformedError):
        ros.decode_frame(whole[:cut])


def test_what_cannot_be_written_is_an_error_of_the_caller() -> None:
    with pytest.raises(ValueError, match="NUL"):
        ros.encode_beat(0, b"a\0b")
    with pytest.raises(ValueError, match="65536"):
        ros.encode_frame(bytes(65536), b"")


def test_a_bare_beat_has_no_text() -> None:
    assert ros.decode_beat(serialize_message(Header())) == b""


def test_topics_name_sender_and_channel() -> None:
    assert ros.topic("robot", "beat") == "/connectivity_test_local"
    assert ros.topic("cloud", "beat") == "/connectivity_test_remote"
    assert ros.topic("cloud", "out/a__b") == "/offload/link/cloud/out_a__b"
    with pytest.raises(ConfigurationError, match="channel"):
        ros.topic("cloud", "out/a-b")


# -- two ends ---------------------------------------------------------------------------------------------------------


class Domain:
    """A ROS context with a node for each side and one for strangers, spun by one thread."""

    def __init__(self) -> None:
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=DOMAIN_ID)
        self.nodes = {
            name: rclpy.create_node(f"link_{name}", context=self.context) for name in ("robot", "cloud", "stranger")
        }
        self.executor = SingleThreadedExecutor(context=self.context)
        for node in self.nodes.values():
            self.executor.add_node(node)
        self.thread = threading.Thread(target=self.spin)
        self.thread.start()
        self.links: list[RosLink] = []

    def spin(self) -> None:
        try:
            self.executor.spin()
        except ExternalShutdownException:
            return

    def link(self, side: str, received: list[tuple[str, bytes, bytes]]) -> RosLink:
        link = RosLink(self.nodes[side], side, CHANNELS, lambda *message: received.append(message))
        link.start()
        self.links.append(link)
        return link

    def close(self) -> None:
        rclpy.shutdown(context=self.context)
        self.thread.join(PATIENCE_S)
        for link in self.links:
            link.close()
        for node in self.nodes.values():
            node.destroy_node()


@pytest.fixture
def domain() -> Iterator[Domain]:
    made = Domain()
    yield made
    made.close()


def eventually(condition: Callable[[], Any]) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end_s, f"not within {PATIENCE_S} s"
        time.sleep(0.02)


def arrives(link: RosLink, heard: list[tuple[str, bytes, bytes]], message: tuple[str, bytes, bytes]) -> bool:
    return link.send(*message) and message in heard


def test_both_directions_carry_header_and_payload_intact(domain: Domain) -> None:
    received: dict[str, list[tuple[str, bytes, bytes]]] = {"robot": [], "cloud": []}
    robot, cloud = domain.link("robot", received["robot"]), domain.link("cloud", received["cloud"])
    eventually(lambda: robot.status().connected and cloud.status().connected)
    big = os.urandom(65536)
    sent = [("out/cmd_vel", b"h", b"x"), ("out/cmd_vel", b"\0\1" * 9, b""), ("out/cmd_vel", b"", big)]
    for link, heard in ((robot, received["cloud"]), (cloud, received["robot"])):
        for message in sent:
            assert link.send(*message)
        eventually(partial(eq, heard, sent))
        for message in (("probe", b"-", b"p"), ("beat", b"", "1;aé".encode())):
            eventually(partial(arrives, link, heard, message))
    assert robot.malformed == cloud.malformed == 0
    assert robot.status().sessions == 1


@pytest.mark.parametrize("size", [2_000_000, 16_000_000])
def test_large_messages_cross_whole(domain: Domain, size: int) -> None:
    heard: list[tuple[str, bytes, bytes]] = []
    robot, cloud = domain.link("robot", heard), domain.link("cloud", [])
    eventually(lambda: robot.status().connected and cloud.status().connected)
    sent = ("out/cmd_vel", b"h", os.urandom(size))
    assert cloud.send(*sent)
    eventually(lambda: heard == [sent])


def test_alone_it_is_not_connected_and_sends_nothing(domain: Domain) -> None:
    robot = domain.link("robot", [])
    assert not robot.status().connected
    assert not robot.send("beat", b"", b"text")
    cloud = domain.link("cloud", [])
    eventually(lambda: robot.status().connected)
    robot.reopen("legal, and without effect")
    assert robot.status().connected
    cloud.close()
    eventually(lambda: not robot.status().connected)
    domain.link("cloud", [])
    eventually(lambda: robot.status().sessions == 2)


def test_a_beat_is_heard_by_any_subscriber_of_a_header(domain: Domain) -> None:
    heard: list[Header] = []
    qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    domain.nodes["stranger"].create_subscription(Header, "/connectivity_test_local", heard.append, qos)
    robot = domain.link("robot", [])
    before = time.time_ns()
    eventually(lambda: robot.send("beat", b"", b"1;7") and heard)
    assert heard[0].frame_id == "1;7"
    assert before <= heard[0].stamp.sec * 10**9 + heard[0].stamp.nanosec <= time.time_ns()


def test_a_header_of_another_tool_is_a_bare_beat(domain: Domain) -> None:
    received: list[tuple[str, bytes, bytes]] = []
    domain.link("robot", received)
    publisher = domain.nodes["stranger"].create_publisher(Header, "/connectivity_test_remote", 1)

    def arrived() -> bool:
        publisher.publish(Header())
        return ("beat", b"", b"") in received

    eventually(arrived)


def test_garbage_on_a_topic_is_counted_and_harms_nothing(domain: Domain) -> None:
    received: list[tuple[str, bytes, bytes]] = []
    robot = domain.link("robot", received)
    publisher = domain.nodes["stranger"].create_publisher(UInt8MultiArray, "/offload/link/cloud/out_cmd_vel", 10)
    eventually(lambda: publisher.get_subscription_count() > 0)
    for data in (b"", b"\x01", b"\xff\xff", b"\x00\x09abc"):
        publisher.publish(UInt8MultiArray(data=data))
    eventually(lambda: robot.malformed == 4)
    cloud = domain.link("cloud", [])
    eventually(lambda: cloud.send("out/cmd_vel", b"h", b"p") and ("out/cmd_vel", b"h", b"p") in received)


def test_a_handler_that_raises_does_not_end_the_executor(domain: Domain, caplog: pytest.LogCaptureFixture) -> None:
    calls: list[str] = []

    def handle(channel: str, _header: bytes, _payload: bytes) -> None:
        calls.append(channel)
        raise ValueError("a bug")

    link = RosLink(domain.nodes["robot"], "robot", CHANNELS, handle)
    link.start()
    domain.links.append(link)
    cloud = domain.link("cloud", [])
    eventually(lambda: cloud.send("out/cmd_vel", b"", b"") and len(calls) > 2)
    assert "a bug" in caplog.text


def test_misuse_is_an_error_of_the_caller(domain: Domain) -> None:
    link = domain.link("robot", [])
    with pytest.raises(KeyError):
        link.send("in/scan", b"", b"")
    with pytest.raises(ValueError, match="no header"):
        link.send("beat", b"header", b"")
    with pytest.raises(ConfigurationError, match="share a topic"):
        RosLink(domain.nodes["robot"], "robot", [Channel("a/b"), Channel("a_b")], print)


def test_after_the_end_of_ros_nothing_is_sent_and_nothing_raises(domain: Domain) -> None:
    link = domain.link("robot", [])
    rclpy.shutdown(context=domain.context)
    assert not link.send("out/cmd_vel", b"", b"")
    assert not link.status().connected
    domain.context = rclpy.Context()
    rclpy.init(context=domain.context, domain_id=DOMAIN_ID)  # for the fixture to shut down
