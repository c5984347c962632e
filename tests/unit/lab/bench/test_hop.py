import socket
from collections.abc import Iterator

import pytest

from robot_offload_lab.bench.parts import hop


@pytest.fixture
def ends() -> Iterator[tuple[socket.socket, socket.socket]]:
    """The robot's end dials the cloud's, with no wire in between."""
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as robot,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as cloud,
    ):
        cloud.bind((hop.HOST, 0))
        robot.connect(cloud.getsockname())
        yield robot, cloud


@pytest.fixture(autouse=True)
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """A busy machine is no loss."""
    monkeypatch.setattr(hop, "PATIENCE_S", 60.0)


def test_all_datagrams_of_a_message_are_waited_for(ends: tuple[socket.socket, socket.socket]):
    robot, cloud = ends
    delay_ms = hop.measure(robot, cloud, 1, 16384)
    assert delay_ms is not None
    assert delay_ms > 0


def test_what_is_late_of_an_earlier_measurement_is_not_counted(ends: tuple[socket.socket, socket.socket]):
    robot, cloud = ends
    robot.send((1).to_bytes(hop.MARK_BYTES, "big"))
    late, back = cloud.recvfrom(64)
    cloud.sendto(late, back)
    assert hop.measure(robot, cloud, 2, 64) is not None
    robot.setblocking(False)
    with pytest.raises(BlockingIOError):  # the late one was taken and left out
        robot.recv(64)


def test_a_message_that_gets_lost_gives_no_delay(
    ends: tuple[socket.socket, socket.socket], monkeypatch: pytest.MonkeyPatch
):
    robot, _ = ends
    monkeypatch.setattr(hop, "PATIENCE_S", 0.05)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as deaf:
        deaf.bind((hop.HOST, 0))
        assert hop.measure(robot, deaf, 1, 64) is None
