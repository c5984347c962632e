"""The Zenoh link with real sessions on the loopback interface and real certificates."""

from __future__ import annotations

import json
import os
import signal
import threading
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest
import zenoh

from robot_offload_agent.errors import ConfigurationError
from robot_offload_agent.link import zenoh_lane
from robot_offload_agent.link.zenoh import ZenohLink
from robot_offload_agent.link.zenoh_config import session_config
from robot_offload_core.words.reasons import Reason
from robot_offload_core.words.settings import LARGEST_MESSAGE
from robot_offload_lab.run.certificates import CertificatePaths
from robot_offload_lab.wire.emulated import EmulatedWire, Forward, WireConfig
from tests.ros.ports import HOST
from tests.ros.zenoh_ends import (
    CHANNELS,
    PATIENCE_S,
    End,
    Ends,
    Gate,
    all_in,
    blocked_udp,
    connected,
    crosses,
    echoes_return,
    eventually,
    make_settings,
)

pytestmark = pytest.mark.ros


def test_the_robot_may_come_first(paths: CertificatePaths, port: int, ends: Ends) -> None:
    robot = ends.open(make_settings(paths, "robot", port))
    eventually(lambda: "session with" in robot.link.status().message)
    assert not robot.link.send("beat", b"", b"nobody hears")
    cloud = ends.open(make_settings(paths, "cloud", port))
    connected(robot, cloud)
    assert robot.link.status().sessions == 1
    assert robot.link.status().endpoint == f"quic/{HOST}:{port}"
    assert robot.link.status().message == ""


@pytest.mark.parametrize("session", ["pulse", "data"])
def test_both_directions_carry_header_and_payload_intact(
    paths: CertificatePaths, port: int, ends: Ends, session: str
) -> None:
    cloud = ends.open(make_settings(paths, "cloud", port, session=session))
    robot = ends.open(make_settings(paths, "robot", port, session=session))
    connected(robot, cloud)
    for sender, receiver in ((robot, cloud), (cloud, robot)):
        for channel in ("beat", "in/scan", "out/cmd"):
            crosses(sender, receiver, channel)
        receiver.received.clear()
        big = os.urandom(65536)
        sent = [
            ("beat", b"", b"text"),
            ("in/scan", b"\x00\x01" * 20, b""),
            ("in/scan", b"h", big),
            ("out/cmd", b"", big),
        ]
        for message in sent:
            assert sender.link.send(*message)
        eventually(partial(all_in, receiver.received, sent))
    assert robot.link.malformed == cloud.link.malformed == 0


def test_bulk_arrives_in_order_and_is_admitted_as_long_as_it_is_acknowledged(
    paths: CertificatePaths, port: int, ends: Ends
) -> None:
    cloud = ends.open(make_settings(paths, "cloud", port, backlog_ms=2000, lease_ms=10000))
    robot = ends.open(make_settings(paths, "robot", port, backlog_ms=2000, lease_ms=10000))
    connected(robot, cloud)
    crosses(robot, cloud)
    begin_s = time.monotonic()
    sent = 0
    while time.monotonic() < begin_s + 3.0:  # longer than the backlog's limit: only acknowledgements let it go on
        assert robot.link.send("in/scan", sent.to_bytes(4, "big"), bytes(10240))
        sent += 1
        time.sleep(0.02)

    def arrived() -> list[int]:
        return [int.from_bytes(header, "big") for _, header, payload in cloud.received if len(payload) == 10240]

    eventually(lambda: len(arrived()) == sent)
    assert arrived() == list(range(sent))


def test_bulk_that_nobody_acknowledges_is_refused(paths: CertificatePaths, port: int, ends: Ends) -> None:
    cloud = ends.process(make_settings(paths, "cloud", port))
    robot = ends.open(make_settings(paths, "robot", port, backlog_ms=50, lease_ms=60_000))
    connected(robot)
    os.kill(cloud.pid, signal.SIGSTOP)
    assert robot.link.send("in/scan", b"", bytes(10240))
    eventually(lambda: not robot.link.send("in/scan", b"", bytes(10240)))
    assert robot.link.send("beat", b"", b"small and urgent passes")


@pytest.fixture
def wire(port: int) -> Iterator[EmulatedWire]:
    """A link in front of the cloud's port."""
    made = EmulatedWire(WireConfig((Forward("data", "udp", f"{HOST}:0", f"{HOST}:{port}"),)))
    made.start()
    yield made
    made.stop()


def test_sixteen_megabytes_cross_a_narrow_link_both_ways_while_small_messages_pass(
    paths: CertificatePaths, port: int, ends: Ends, wire: EmulatedWire
) -> None:
    cloud = ends.open(make_settings(paths, "cloud", port, lease_ms=10_000))
    robot = ends.open(make_settings(paths, "robot", wire.port("data"), lease_ms=10_000))
    connected(robot, cloud)
    wire.set(rate_kbit_s=80_000, queue_ms=100)
    for sender, receiver in ((robot, cloud), (cloud, robot)):
        crosses(sender, receiver)
        large = os.urandom(LARGEST_MESSAGE)
        assert sender.link.send("in/scan", b"large", large)
        assert not sender.link.send("in/scan", b"next", b"none overtakes it")
        crosses(sender, receiver, "out/cmd")
        eventually(partial(all_in, receiver.received, [("in/scan", b"large", large)]), "the large message")
        order = [channel for channel, _, payload in receiver.received if channel == "out/cmd" or len(payload) > 10_000]
        assert order[0] == "out/cmd", "a small one passes while the large one is on its way"
        eventually(lambda s=sender: s.room == ["in/scan"], "there is room again")  # type: ignore[misc]
        crosses(sender, receiver)
    assert robot.link.malformed == cloud.link.malformed == 0


def test_a_lost_acknowledgement_holds_nothing_up(
    paths: CertificatePaths, port: int, ends: Ends, wire: EmulatedWire
) -> None:
    # Nothing is admitted while one is on its way, and none is ever forgotten.
    cloud = ends.open(make_settings(paths, "cloud", port, lease_ms=60_000))
    robot = ends.open(make_settings(paths, "robot", wire.port("data"), lease_ms=60_000, backlog_ms=0.001))
    connected(robot, cloud)
    crosses(robot, cloud)
    wire.set(loss=0.1)
    robot.received.clear()
    cloud.received.clear()

    def many() -> bool:
        robot.link.send("in/scan", b"", bytes(2000))
        return len(cloud.received) > 150

    eventually(many, "messages over a link that loses packets")


def test_over_a_link_that_is_too_narrow_for_two_topics_the_one_of_higher_priority_passes_more_often(
    paths: CertificatePaths, port: int, ends: Ends, wire: EmulatedWire
) -> None:
    cloud = ends.open(make_settings(paths, "cloud", port, lease_ms=10_000))
    robot = ends.open(make_settings(paths, "robot", wire.port("data"), lease_ms=10_000))
    connected(robot, cloud)
    crosses(robot, cloud)
    wire.set(delay_ms=10, rate_kbit_s=8000, queue_ms=100)
    taken = {"in/last": 0, "in/first": 0}

    def enough() -> bool:
        for channel in taken:
            taken[channel] += robot.link.send(channel, b"", bytes(60_000))
        time.sleep(0.05)  # many times what the link carries, also on a slow machine
        return taken["in/first"] >= 60

    eventually(enough, "one of them passes")
    assert taken["in/last"] < taken["in/first"] * 0.8, taken


def test_a_killed_cloud_that_returns_is_found_again(paths: CertificatePaths, port: int, ends: Ends) -> None:
    cloud = ends.process(make_settings(paths, "cloud", port))
    robot = ends.open(make_settings(paths, "robot", port))
    connected(robot)
    cloud.kill()
    eventually(lambda: not robot.link.status().connected)
    assert not robot.link.send("beat", b"", b"nobody hears")
    ends.process(make_settings(paths, "cloud", port))
    connected(robot)
    assert robot.link.status().sessions == 2
    echoes_return(robot)


def test_a_killed_robot_is_missed_by_the_cloud(paths: CertificatePaths, port: int, ends: Ends) -> None:
    cloud = ends.open(make_settings(paths, "cloud", port))
    robot = ends.process(make_settings(paths, "robot", port))
    connected(cloud)
    robot.kill()
    eventually(lambda: not cloud.link.status().connected)
    eventually(lambda: cloud.link.status().message == "no robot is connected")


def test_a_process_forked_after_the_import_has_a_working_link(paths: CertificatePaths, port: int, ends: Ends) -> None:
    ends.process(make_settings(paths, "cloud", port), fork=True)
    robot = ends.open(make_settings(paths, "robot", port))
    connected(robot)
    echoes_return(robot)


def test_reopen_gives_a_new_session_from_a_new_port(paths: CertificatePaths, port: int, ends: Ends) -> None:
    cloud = ends.open(make_settings(paths, "cloud", port))
    robot = ends.open(make_settings(paths, "robot", port))
    connected(robot, cloud)
    crosses(robot, cloud)
    robot.link.reopen("a test wants it")
    robot.link.reopen("ignored, for it is being reopened")
    assert not robot.link.status().connected
    eventually(lambda: robot.link.status().sessions == 2 and robot.link.status().connected)
    eventually(lambda: cloud.link.status().sessions == 2)
    crosses(robot, cloud)
    crosses(cloud, robot)
    assert robot.link.status().sessions == 2


def test_reopen_is_legal_at_any_time_and_on_both_sides(paths: CertificatePaths, port: int, ends: Ends) -> None:
    robot = ends.open(make_settings(paths, "robot", port))
    robot.link.reopen("nothing is open yet")
    cloud = ends.open(make_settings(paths, "cloud", port))
    connected(robot, cloud)
    cloud.link.reopen("the listener stays")
    crosses(robot, cloud)
    assert robot.link.status().sessions == 1


def test_where_udp_is_blocked_tls_is_used_until_udp_works(paths: CertificatePaths, port: int, ends: Ends) -> None:
    fallback = (f"tls/{HOST}:{port}",)
    with blocked_udp(0) as free:
        behind = free.getsockname()[1]
    gate = Gate(port, behind)
    try:
        listened = (f"quic/{HOST}:{behind}",)
        cloud = ends.open(make_settings(paths, "cloud", port, endpoints=listened, fallback=fallback))
        patience = {"fallback": fallback, "fallback_after_ms": 600, "primary_retry_s": 0.5}
        robot = ends.open(make_settings(paths, "robot", port, **patience))
        connected(robot, cloud)
        assert robot.link.status().fallback
        assert robot.link.status().endpoint == fallback[0]
        eventually(lambda: cloud.link.status().fallback)
        crosses(robot, cloud)
        crosses(cloud, robot)
        gate.is_open = True
        sent, end_s = 0, time.monotonic() + PATIENCE_S
        while robot.link.status().fallback or sent < 10:
            sent += cloud.link.send("in/scan", b"count", bytes([sent]))
            time.sleep(0.1)
            assert sent < 200, "the primary was not taken up again"
            assert time.monotonic() < end_s, robot.link.status()
        assert robot.link.status().connected
        assert robot.link.status().endpoint == f"quic/{HOST}:{port}"
        eventually(lambda: not cloud.link.status().fallback)
        crosses(robot, cloud)
        crosses(cloud, robot)
        counted = [payload[0] for _, header, payload in robot.received if header == b"count"]
        assert sorted(set(counted)) == list(range(sent)), "the change cost messages"
        assert len(counted) <= sent + 1
    finally:
        gate.close()


def test_without_any_cloud_primary_and_fallback_alternate(paths: CertificatePaths, port: int, ends: Ends) -> None:
    robot = ends.open(make_settings(paths, "robot", port, fallback=(f"tls/{HOST}:{port}",), fallback_after_ms=300))
    eventually(lambda: robot.link.status().fallback)
    eventually(lambda: not robot.link.status().fallback)
    assert not robot.link.status().connected


# -- garbage, limits, ends --------------------------------------------------------------------------------------------


def test_garbage_under_our_keys_is_counted_and_harms_nothing(paths: CertificatePaths, port: int, ends: Ends) -> None:
    cloud = ends.open(make_settings(paths, "cloud", port))
    robot = ends.open(make_settings(paths, "robot", port))
    connected(robot, cloud)
    config = session_config(make_settings(paths, "robot", port), open_timeout_ms=round(PATIENCE_S * 1e3))
    prefix = "robot_offload/wheelchair-7/robot/data"
    with zenoh.open(zenoh.Config.from_json5(json.dumps(config))) as stranger:
        for attachment in (None, b"", b"\x00", b"\xff\xff\xff"):
            stranger.put(f"{prefix}/in/scan", b"junk", attachment=attachment)
        for payload in (b"", b"\x00", b"\xff" * 40, b"\x00\x00\x00\x01no/such/channel", b"\x00\x00\x00\x09in/scan"):
            stranger.put(f"{prefix}/_ack", payload)
        stranger.put(f"{prefix}/in/scan", b"junk", attachment=b"\xff\xff\xff\xff")  # well-formed: for others to judge
        stranger.put(f"{prefix}/no/such/channel", b"junk", attachment=bytes(9))
        eventually(lambda: cloud.link.malformed == 8)
    crosses(robot, cloud)
    crosses(cloud, robot)


def test_a_handler_that_raises_does_not_end_the_link(
    paths: CertificatePaths, port: int, ends: Ends, caplog: pytest.LogCaptureFixture
) -> None:
    cloud = ends.open(make_settings(paths, "cloud", port))
    handled: list[bytes] = []

    def handle(_channel: str, _header: bytes, payload: bytes) -> None:
        handled.append(payload)
        raise ValueError("a bug")

    robot = ZenohLink(make_settings(paths, "robot", port), CHANNELS, handle)
    robot.start()
    try:
        eventually(lambda: cloud.link.send("beat", b"", b"x") and len(handled) > 3)
        assert "a bug" in caplog.text
    finally:
        robot.close()


def test_a_channel_that_was_not_declared_is_an_error_of_the_caller(paths: CertificatePaths, port: int) -> None:
    end = End(make_settings(paths, "robot", port))
    assert not end.link.send("beat", b"", b"not started")
    with pytest.raises(KeyError, match="in/scan"):
        end.link.send("scan", b"", b"")
    with pytest.raises(ConfigurationError, match="each name once"):
        ZenohLink(end.link.settings, [CHANNELS[0], CHANNELS[0]], print)


@pytest.mark.parametrize("side", ["robot", "cloud"])
def test_close_during_opening_returns_and_ends_the_thread(paths: CertificatePaths, port: int, side: str) -> None:
    with blocked_udp(port):  # the robot gets no answer; the cloud cannot listen
        end = End(make_settings(paths, side, port))
        end.link.start()
        eventually(lambda: end.link.status().message != "not started")
        end.link.close()
    eventually(lambda: not any(t.name == "link-data" for t in threading.enumerate()), "its thread ends")
    assert end.link.status().message == "closed"
    assert not end.link.send("beat", b"", b"closed")


def test_a_taken_port_is_told_and_used_once_it_is_free(paths: CertificatePaths, port: int, ends: Ends) -> None:
    with blocked_udp(port):
        cloud = ends.open(make_settings(paths, "cloud", port))
        eventually(lambda: "Address already in use" in cloud.link.status().message)
        assert f"quic/{HOST}:{port}" in cloud.link.status().message
    connected(ends.open(make_settings(paths, "robot", port)), cloud)


def test_sigterm_works_while_a_session_is_being_opened(paths: CertificatePaths, port: int, ends: Ends) -> None:
    with blocked_udp(port):
        longer_ms = round(2 * PATIENCE_S * 1e3)
        robot = ends.process(
            make_settings(paths, "robot", port, open_timeout_ms=longer_ms, slow_open_timeout_ms=longer_ms)
        )
        time.sleep(0.7)
        robot.terminate()
        assert robot.wait(PATIENCE_S) == 0


def tcp_bears_loss(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Lets the robot believe that its kernel uses BBR."""
    control = folder / "tcp_congestion_control"
    control.write_text("bbr\n", encoding="ascii")
    monkeypatch.setattr(zenoh_lane, "CONGESTION_CONTROL", control)


def test_after_a_stale_input_the_next_large_message_opens_their_own_session(
    paths: CertificatePaths, port: int, ends: Ends, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tcp_bears_loss(tmp_path, monkeypatch)
    fallback = (f"tls/{HOST}:{port}",)
    cloud = ends.open(make_settings(paths, "cloud", port, fallback=fallback))
    robot = ends.open(make_settings(paths, "robot", port, fallback=fallback))
    connected(robot, cloud)
    listener = cloud.link._session
    assert listener is not None
    image = os.urandom(200_000)

    def arrived() -> bool:
        return robot.link.send("in/scan", b"h", image) and ("in/scan", b"h", image) in cloud.received

    eventually(arrived, "an image")
    assert listener.protocols() == {"quic"}
    robot.link.reopen(Reason.INPUT_STALE)
    connected(robot, cloud)
    eventually(lambda: arrived() and listener.protocols() == {"quic", "tls"}, "an image through a session of its own")


def test_large_messages_take_a_session_of_their_own_where_the_robots_tcp_bears_loss(
    paths: CertificatePaths, port: int, ends: Ends, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tcp_bears_loss(tmp_path, monkeypatch)
    fallback = (f"tls/{HOST}:{port}",)
    cloud = ends.open(make_settings(paths, "cloud", port, fallback=fallback))
    # So small a backlog refuses each second message, as loss does.
    robot = ends.open(make_settings(paths, "robot", port, fallback=fallback, backlog_ms=0.001))
    connected(robot, cloud)
    crosses(robot, cloud)
    listener = cloud.link._session
    assert listener is not None
    assert listener.protocols() == {"quic"}
    image = os.urandom(200_000)

    def arrived() -> bool:
        for _ in range(2):
            robot.link.send("in/scan", b"h", image)
        return listener.protocols() == {"quic", "tls"} and ("in/scan", b"h", image) in cloud.received

    eventually(arrived, "an image through a session of its own")
    assert listener.connections == 1  # the same robot
    eventually(lambda: "in/scan" in robot.room, "that there is room again after a refusal is said")
    eventually(lambda: robot.link.send("in/scan", b"once", image), "it is taken")
    eventually(lambda: ("in/scan", b"once", image) in cloud.received, "the image again")
    crosses(robot, cloud, "beat")
    crosses(cloud, robot, "out/cmd")
    time.sleep(0.5)  # a second one would have come by now
    assert [header for _, header, _ in cloud.received].count(b"once") == 1
    assert (robot.link.status().fallback, robot.link.status().message, cloud.link.status().message) == (False, "", "")
    robot.link.reopen("a dead verdict")
    eventually(lambda: "tls" not in listener.protocols(), "what was buffered is dropped")
    connected(robot, cloud)
    crosses(robot, cloud)
    cloud.received.clear()
    eventually(arrived, "an image through a new session of its own")
