"""Six ways for a session not to come about, and a sentence of its own for each, on the robot and in the cloud."""

from __future__ import annotations

import datetime
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from robot_offload_agent.link.port import LinkCause
from robot_offload_agent.link.zenoh_log import WheelLog
from robot_offload_lab.run.certificates import CertificatePaths, make_certificates
from tests.ros.ports import HOST, free_port
from tests.ros.zenoh_ends import (
    End,
    Ends,
    blocked_udp,
    connected,
    eventually,
    make_settings,
    new_certificates,
)

pytestmark = pytest.mark.ros


Both = Callable[[dict[str, Any], dict[str, Any]], tuple[End, End]]


@pytest.fixture
def wheel() -> Iterator[Callable[[], WheelLog]]:
    """To be called in the test itself: pytest changes the standard output between setup and test."""
    made: list[WheelLog] = []

    def make() -> WheelLog:
        made[:] = made or [WheelLog()]
        return made[0]

    yield make
    for log in made:
        log.close()


@pytest.fixture
def both(paths: CertificatePaths, port: int, ends: Ends, wheel: Callable[[], WheelLog]) -> Both:
    """Makes a pair of ends with these changes for the robot and for the cloud."""

    def make(robot: dict[str, Any], cloud: dict[str, Any]) -> tuple[End, End]:
        tls = {"fallback": (f"tls/{HOST}:{port}",)}
        far = ends.open(make_settings(paths, "cloud", port, **{**tls, **cloud}), wheel())
        eventually(lambda: far.link.status().message == "no robot is connected")
        return ends.open(make_settings(paths, "robot", port, **{**tls, **robot}), wheel()), far

    return make


def says(end: End, cause: LinkCause, *words: str) -> None:
    def said() -> bool:
        status = end.link.status()
        return status.cause is cause and all(word in status.message for word in words)

    try:
        eventually(said)
    except AssertionError:
        raise AssertionError(f"not {cause.value} with {words} but {end.link.status()}") from None


def test_a_name_that_nobody_knows(both: Both) -> None:
    robot, _ = both({"endpoints": ("quic/nosuch.invalid:7447",), "fallback": ()}, {})
    says(robot, LinkCause.UNKNOWN_NAME, "nosuch.invalid", "DNS")


def test_an_address_where_nobody_answers(both: Both) -> None:
    nobody = free_port()
    elsewhere = {"endpoints": (f"quic/{HOST}:{nobody}",), "fallback": (f"tls/{HOST}:{nobody}",)}
    robot, _ = both({**elsewhere, "fallback_after_ms": 1}, {})
    says(robot, LinkCause.NO_ANSWER, "quic/", "firewalls")
    eventually(lambda: "tls/" in robot.link.status().message, "the fallback as well")
    assert robot.link.status().cause is LinkCause.NO_ANSWER


@pytest.mark.parametrize("way", ["quic", "tls"])
def test_a_certificate_that_the_cloud_refuses(both: Both, tmp_path: Path, way: str) -> None:
    foreign = new_certificates(tmp_path)
    stranger = {"certificate": str(foreign.robot.certificate), "private_key": str(foreign.robot.private_key)}
    robot, cloud = both(stranger | _over(way), {})
    says(robot, LinkCause.CERTIFICATE_REFUSED, str(foreign.robot.certificate), "write the bundle again")
    says(cloud, LinkCause.CERTIFICATE_REFUSED, "Refused a robot", "write its bundle again")
    assert dict(cloud.link.status().counters)["refused"] >= 1


@pytest.mark.parametrize("way", ["quic", "tls"])
def test_a_cloud_of_another_authority(both: Both, tmp_path: Path, way: str) -> None:
    foreign = new_certificates(tmp_path)
    robot, cloud = both({"ca": str(foreign.robot.ca)} | _over(way), {})
    says(robot, LinkCause.WRONG_AUTHORITY, str(foreign.robot.ca), "write the bundle again")
    says(cloud, LinkCause.CERTIFICATE_REFUSED, "refuses this cloud's certificate", "write its bundle again")


def test_a_certificate_that_has_ended(both: Both, tmp_path: Path) -> None:
    before = datetime.datetime.now(datetime.UTC) - datetime.timedelta(days=60)
    old = make_certificates(tmp_path / "old", robot="wheelchair-7", host_names=[HOST], now=before)
    robot, _ = both(
        {"ca": str(old.robot.ca)},
        {"certificate": str(old.cloud.certificate), "private_key": str(old.cloud.private_key)},
    )
    says(robot, LinkCause.CERTIFICATE_EXPIRED, "clock")


def test_a_cloud_for_another_host(both: Both, tmp_path: Path) -> None:
    made = new_certificates(tmp_path, "cloud.example")
    changes = {"certificate": str(made.cloud.certificate), "private_key": str(made.cloud.private_key)}
    robot, _ = both({"ca": str(made.robot.ca)}, changes)
    says(robot, LinkCause.WRONG_NAME, "another host")


@pytest.mark.parametrize("session", ["pulse", "data"])
def test_a_robot_whose_resource_was_made_anew(both: Both, session: str) -> None:
    robot, cloud = both({"uid": "before", "session": session}, {"uid": "after", "session": session})
    says(robot, LinkCause.OTHER_IDENTITY, "uid after", "for before", "write the bundle again")
    says(cloud, LinkCause.OTHER_IDENTITY, "wheelchair-7", "uid after", "write the bundle again")
    assert not robot.link.status().connected
    assert robot.link.status().sessions == 1, "it does not dial again and again"


def test_udp_that_is_blocked(both: Both) -> None:
    hole = free_port()
    with blocked_udp(hole):
        robot, cloud = both({"endpoints": (f"quic/{HOST}:{hole}",), "fallback_after_ms": 1}, {})
        connected(robot, cloud)
        says(robot, LinkCause.UDP_BLOCKED, f"UDP to quic/{HOST}:{hole}", "open the UDP port")


def test_a_name_in_the_certificate_that_is_another_robots(both: Both) -> None:
    _robot, cloud = both({}, {"peer_name": "wheelchair-8"})
    says(cloud, LinkCause.STRANGER, "wheelchair-7", "only wheelchair-8 is served")


def test_two_sessions_of_one_robot_for_longer_than_a_changeover(
    both: Both, paths: CertificatePaths, port: int, ends: Ends
) -> None:
    robot, cloud = both({}, {})
    connected(robot, cloud)
    copy = ends.open(make_settings(paths, "robot", port))
    connected(copy)
    eventually(lambda: _talks(robot, copy) and cloud.link.status().cause is LinkCause.SECOND_SESSION, "noticed")
    status = cloud.link.status()
    assert "revoke" in status.message
    assert status.connected
    assert dict(status.counters)["second_session"] == 1
    copy.link.close()
    eventually(lambda: _talks(robot) and cloud.link.status().cause is LinkCause.NONE, "over")


def _talks(*robots: End) -> bool:
    return all(robot.link.send("beat", b"", b"beat") for robot in robots)


def _over(way: str) -> dict[str, Any]:
    return {} if way == "quic" else {"endpoints": (f"quic/{HOST}:{free_port()}",), "fallback_after_ms": 1}
