"""Whom the Zenoh link lets in, and which certificate files it accepts and reads anew."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import zenoh

from robot_offload_agent.errors import ConfigurationError
from robot_offload_agent.link.zenoh_config import session_config
from robot_offload_lab.run.certificates import CertificatePaths
from tests.ros.ports import HOST
from tests.ros.zenoh_ends import (
    End,
    Ends,
    connected,
    eventually,
    make_settings,
    never_connects,
    new_certificates,
)

pytestmark = pytest.mark.ros


@pytest.mark.parametrize("fallback", [False, True])
def test_a_robot_with_a_certificate_of_another_authority_is_refused(
    paths: CertificatePaths, port: int, ends: Ends, tmp_path: Path, fallback: bool
) -> None:
    foreign = new_certificates(tmp_path)
    tls = (f"tls/{HOST}:{port}",)
    cloud = ends.open(make_settings(paths, "cloud", port, fallback=tls))
    stranger = {"certificate": str(foreign.robot.certificate), "private_key": str(foreign.robot.private_key)}
    changes: dict[str, Any] = {"fallback": tls, "fallback_after_ms": 1} if fallback else {}
    robot = ends.open(make_settings(paths, "robot", port, **stranger, **changes))
    never_connects(robot, cloud)
    eventually(lambda: "certificate was refused" in robot.link.status().message)


def test_a_cloud_with_a_certificate_of_another_authority_is_refused(
    paths: CertificatePaths, port: int, ends: Ends, tmp_path: Path
) -> None:
    foreign = new_certificates(tmp_path)
    stranger = {"certificate": str(foreign.cloud.certificate), "private_key": str(foreign.cloud.private_key)}
    cloud = ends.open(make_settings(paths, "cloud", port, **stranger))
    never_connects(ends.open(make_settings(paths, "robot", port)), cloud)


@pytest.mark.parametrize("protocol", ["quic", "tls"])
def test_who_shows_no_certificate_is_refused(paths: CertificatePaths, port: int, ends: Ends, protocol: str) -> None:
    tls = (f"tls/{HOST}:{port}",)
    cloud = ends.open(make_settings(paths, "cloud", port, fallback=tls))
    eventually(lambda: cloud.link.status().message == "no robot is connected")
    config = session_config(make_settings(paths, "robot", port, fallback=tls), fallback=protocol == "tls")
    config["transport"]["link"]["tls"] = {"root_ca_certificate": str(paths.robot.ca)}
    with pytest.raises(zenoh.ZError):
        zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
    assert not cloud.link.status().connected


def test_a_cloud_under_another_name_passes_only_where_its_common_name_is_checked_instead(
    port: int, ends: Ends, tmp_path: Path
) -> None:
    paths = new_certificates(tmp_path, "cloud.example")  # but the robot dials 127.0.0.1
    ends.open(make_settings(paths, "cloud", port))
    never_connects(ends.open(make_settings(paths, "robot", port)), None)
    connected(ends.open(make_settings(paths, "robot", port, verify_name=False)))
    other = ends.open(make_settings(paths, "robot", port, verify_name=False, peer_name="somebody-else"))
    never_connects(other, None)
    eventually(lambda: "its certificate names cloud, not somebody-else" in other.link.status().message)


@pytest.mark.parametrize("name", ["ca", "certificate", "private_key"])
def test_a_missing_file_is_named_at_construction(paths: CertificatePaths, port: int, tmp_path: Path, name: str) -> None:
    missing = tmp_path / "missing.pem"
    with pytest.raises(ConfigurationError, match=f"{name} {missing}"):
        End(make_settings(paths, "robot", port, **{name: str(missing)}))


def test_a_key_of_another_certificate_and_an_empty_ca_are_named_at_construction(
    paths: CertificatePaths, port: int, tmp_path: Path
) -> None:
    with pytest.raises(ConfigurationError, match="private_key"):
        End(make_settings(paths, "robot", port, private_key=str(paths.cloud.private_key)))
    empty = tmp_path / "empty.pem"
    empty.write_text("no certificate\n")
    with pytest.raises(ConfigurationError, match=r"empty\.pem"):
        End(make_settings(paths, "robot", port, ca=str(empty)))


def test_a_robot_reads_new_certificates_when_it_dials_again(port: int, ends: Ends, tmp_path: Path) -> None:
    paths = new_certificates(tmp_path)
    cloud = ends.process(make_settings(paths, "cloud", port))
    robot = ends.open(make_settings(paths, "robot", port))
    connected(robot)
    new_certificates(tmp_path)  # all of them, in the same files
    cloud.kill()
    eventually(lambda: not robot.link.status().connected)
    ends.process(make_settings(paths, "cloud", port))
    connected(robot)
