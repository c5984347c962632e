"""Certificates: what they say, and that real Zenoh sessions accept the right ones and refuse all others."""

from __future__ import annotations

import contextlib
import datetime
import ipaddress
import json
import stat
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import zenoh
from cryptography import x509
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from robot_offload.render.pki import (
    CertificateError,
    KeyPair,
    build_authority,
    build_certificates,
    issue_cloud,
    issue_robot,
)
from robot_offload_lab.run.certificates import CertificatePaths, SidePaths, make_certificates
from robot_offload_lab.run.free import free_ports

PATIENCE_S = 60
NOW = datetime.datetime(2026, 3, 1, 12, 0, 0, 123456, tzinfo=datetime.UTC)


def read(pair: KeyPair) -> x509.Certificate:
    return x509.load_pem_x509_certificate(pair.certificate)


def common_name(name: x509.Name) -> str:
    return str(name.get_attributes_for_oid(NameOID.COMMON_NAME)[0].value)


def test_each_side_is_signed_by_an_authority_of_its_own() -> None:
    made = build_certificates(robot="wheelchair-7", host_names=["127.0.0.1"], now=NOW)
    read(made.cloud).verify_directly_issued_by(read(made.server_ca))
    read(made.robot).verify_directly_issued_by(read(made.client_ca))
    with pytest.raises(ValueError, match="Issuer"):
        read(made.robot).verify_directly_issued_by(read(made.server_ca))
    assert read(made.server_ca).subject != read(made.client_ca).subject


def test_the_robot_is_a_client_only_and_the_cloud_a_server_only() -> None:
    made = build_certificates(robot="wheelchair-7", host_names=["cloud.example", "10.1.2.3", "::1"], now=NOW)
    robot, cloud = read(made.robot), read(made.cloud)
    assert [*robot.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value] == [ExtendedKeyUsageOID.CLIENT_AUTH]
    assert [*cloud.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value] == [ExtendedKeyUsageOID.SERVER_AUTH]
    assert common_name(robot.subject) == "wheelchair-7"
    names = cloud.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert names.get_values_for_type(x509.DNSName) == ["cloud.example"]
    assert names.get_values_for_type(x509.IPAddress) == [ipaddress.ip_address("10.1.2.3"), ipaddress.ip_address("::1")]


def test_authorities_sign_leaves_only_and_leaves_sign_nothing() -> None:
    made = build_certificates(robot="r", host_names=["localhost"], now=NOW)
    for authority in (made.server_ca, made.client_ca):
        extensions = read(authority).extensions
        basic = extensions.get_extension_for_class(x509.BasicConstraints)
        assert (basic.value.ca, basic.value.path_length, basic.critical) == (True, 0, True)
        assert extensions.get_extension_for_class(x509.KeyUsage).value.key_cert_sign
    for leaf in (made.robot, made.cloud):
        extensions = read(leaf).extensions
        assert not extensions.get_extension_for_class(x509.BasicConstraints).value.ca
        assert not extensions.get_extension_for_class(x509.KeyUsage).value.key_cert_sign


def test_validity_begins_an_hour_early_and_ends_with_the_authority() -> None:
    authority = build_authority("short", now=NOW, days=10)
    leaf = read(issue_robot(authority, robot="r", now=NOW + datetime.timedelta(days=5), days=30))
    whole = NOW.replace(microsecond=0)
    assert read(authority).not_valid_before_utc == whole - datetime.timedelta(hours=1)
    assert read(authority).not_valid_after_utc == whole + datetime.timedelta(days=10)
    assert leaf.not_valid_after_utc == whole + datetime.timedelta(days=10)


def test_keys_are_p256_in_pkcs8_and_never_shown() -> None:
    made = build_certificates(robot="r", host_names=["localhost"], now=NOW)
    for pair in (made.server_ca, made.client_ca, made.cloud, made.robot):
        assert pair.private_key.startswith(b"-----BEGIN PRIVATE KEY-----")
        key = serialization.load_pem_private_key(pair.private_key, password=None)
        assert isinstance(key, ec.EllipticCurvePrivateKey)
        assert key.curve.name == "secp256r1"
        assert key.public_key() == read(pair).public_key()
        assert "PRIVATE" not in repr(made)


@pytest.mark.parametrize("robot", ["", "-x", "a b", "ä", "x" * 64, "a/b", "x\n"])
def test_an_unusable_robot_name_is_refused(robot: str) -> None:
    with pytest.raises(CertificateError, match="use up to 63 letters, digits"):
        build_certificates(robot=robot, host_names=["localhost"], now=NOW)


def test_the_longest_robot_name_fits() -> None:
    made = build_certificates(robot="x" * 63, host_names=["localhost"], now=NOW)
    assert common_name(read(made.robot).subject) == "x" * 63


@pytest.mark.parametrize(
    "host", ["", "https://cloud", "cloud:7447", "a..b", "-a", "a" * 64, "*.example", "300.1.1.1/8"]
)
def test_an_unusable_host_name_is_refused(host: str) -> None:
    with pytest.raises(CertificateError, match="neither a DNS name nor an IP address"):
        build_certificates(robot="r", host_names=["localhost", host], now=NOW)


def test_a_cloud_without_a_host_name_a_naive_time_and_no_days_are_refused() -> None:
    authority = build_authority("a", now=NOW, days=1)
    with pytest.raises(CertificateError, match="at least one DNS name or IP address"):
        issue_cloud(authority, host_names=[], now=NOW, days=1)
    with pytest.raises(CertificateError, match="time zone"):
        build_authority("a", now=NOW.replace(tzinfo=None), days=1)
    with pytest.raises(CertificateError, match="at least 1 day"):
        build_authority("a", now=NOW, days=0)


def test_files_are_closed_to_others_and_authority_keys_are_not_written(tmp_path: Path) -> None:
    directory = tmp_path / "new" / "certificates"
    paths = make_certificates(directory, robot="r", host_names=["localhost"], now=NOW)
    assert stat.S_IMODE(directory.stat().st_mode) == 0o700
    for side in (paths.robot, paths.cloud):
        assert stat.S_IMODE(side.private_key.stat().st_mode) == 0o600
    assert sorted(path.name for path in directory.iterdir()) == [
        "client-ca.pem", "cloud.key", "cloud.pem", "robot.key", "robot.pem", "server-ca.pem",
    ]  # fmt: skip
    before = paths.robot.certificate.read_bytes()
    assert make_certificates(directory, robot="r", host_names=["localhost"], now=NOW) == paths
    assert paths.robot.certificate.read_bytes() != before


# Real sessions


def session_config(side: str, files: SidePaths, endpoint: str) -> zenoh.Config:
    role = "listen" if side == "cloud" else "connect"
    config: dict[str, Any] = {
        "mode": "router" if side == "cloud" else "client",
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "listen": {"endpoints": []},
        "transport": {
            "shared_memory": {"enabled": False},
            "unicast": {"open_timeout": 500, "accept_timeout": 500},
            "link": {
                "tls": {
                    "root_ca_certificate": str(files.ca),
                    "enable_mtls": True,
                    f"{role}_certificate": str(files.certificate),
                    f"{role}_private_key": str(files.private_key),
                    "verify_name_on_connect": True,
                }
            },
        },
        role: {"endpoints": [endpoint]},
    }
    if side == "robot":
        config["connect"] = {"endpoints": [endpoint], "timeout_ms": 0, "exit_on_failure": True}
    return zenoh.Config.from_json5(json.dumps(config))


@contextlib.contextmanager
def listening(files: SidePaths, protocol: str) -> Iterator[int]:
    (port, _), _ = free_ports()
    with zenoh.open(session_config("cloud", files, f"{protocol}/127.0.0.1:{port}")) as cloud:
        queryable = cloud.declare_queryable("who", lambda query: query.reply("who", b"the cloud"))
        yield port
        del queryable  # it lives as long as the session


def answered(files: SidePaths, protocol: str, port: int, host: str = "127.0.0.1") -> bytes:
    """What the cloud answers, also where a busy machine misses the time for opening a session; empty: never."""
    deadline_s = time.monotonic() + PATIENCE_S
    while not (found := ask(files, protocol, port, host)) and time.monotonic() < deadline_s:
        time.sleep(0.05)
    return found


def ask(files: SidePaths, protocol: str, port: int, host: str = "127.0.0.1") -> bytes:
    """What the cloud answers; empty when no session comes about at once."""
    try:
        with zenoh.open(session_config("robot", files, f"{protocol}/{host}:{port}")) as robot:
            deadline_s = time.monotonic() + 5
            while time.monotonic() < deadline_s:
                for reply in robot.get("who", timeout=1.0):
                    if reply.ok is not None:
                        return bytes(reply.ok.payload.to_bytes())
                time.sleep(0.05)
    except zenoh.ZError:
        pass
    return b""


@pytest.fixture(scope="module")
def ours(tmp_path_factory: pytest.TempPathFactory) -> CertificatePaths:
    now = datetime.datetime.now(datetime.UTC)
    directory = tmp_path_factory.mktemp("ours")
    return make_certificates(directory, robot="r", host_names=["127.0.0.1", "localhost"], now=now)


@pytest.fixture(scope="module")
def foreign(tmp_path_factory: pytest.TempPathFactory) -> CertificatePaths:
    now = datetime.datetime.now(datetime.UTC)
    return make_certificates(tmp_path_factory.mktemp("foreign"), robot="r", host_names=["127.0.0.1"], now=now)


@pytest.mark.parametrize("protocol", ["quic", "tls"])
def test_robot_and_cloud_open_a_session_with_separate_authorities(ours: CertificatePaths, protocol: str) -> None:
    with listening(ours.cloud, protocol) as port:
        assert answered(ours.robot, protocol, port) == b"the cloud"
        assert answered(ours.robot, protocol, port, host="localhost") == b"the cloud"


@pytest.mark.parametrize("protocol", ["quic", "tls"])
def test_a_robot_with_foreign_certificates_is_refused(
    ours: CertificatePaths, foreign: CertificatePaths, protocol: str
) -> None:
    # It trusts our cloud, so the cloud alone decides.
    stranger = replace(foreign.robot, ca=ours.robot.ca)
    with listening(ours.cloud, protocol) as port:
        assert ask(stranger, protocol, port) == b""


@pytest.mark.parametrize("protocol", ["quic", "tls"])
def test_a_cloud_with_foreign_certificates_is_refused(
    ours: CertificatePaths, foreign: CertificatePaths, protocol: str
) -> None:
    # It trusts our robot, so the robot alone decides.
    with listening(replace(foreign.cloud, ca=ours.cloud.ca), protocol) as port:
        assert ask(ours.robot, protocol, port) == b""


@pytest.mark.parametrize("protocol", ["quic", "tls"])
def test_a_robot_cannot_play_the_cloud(ours: CertificatePaths, protocol: str) -> None:
    impostor = replace(ours.robot, ca=ours.cloud.ca)
    with listening(impostor, protocol) as port:
        assert ask(ours.robot, protocol, port) == b""


def test_a_cloud_dialled_by_another_name_is_refused(tmp_path: Path) -> None:
    now = datetime.datetime.now(datetime.UTC)
    files = make_certificates(tmp_path, robot="r", host_names=["cloud.example"], now=now)
    with listening(files.cloud, "quic") as port:
        assert ask(files.robot, "quic", port) == b""
