"""Writes the certificates for running both sides on one machine."""

from __future__ import annotations

import datetime
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from robot_offload.render.pki import build_certificates, issue_robot


@dataclass(frozen=True)
class SidePaths:
    """The certificate files that one side's agent is configured with.

    Attributes:
        ca: the authority that this side trusts, which signed the *other* side's certificate.
        certificate: this side's own.
        private_key: readable by the owner only.
    """

    ca: Path
    certificate: Path
    private_key: Path


@dataclass(frozen=True)
class CertificatePaths:
    """The files of both sides."""

    robot: SidePaths
    cloud: SidePaths


def client_paths(directory: Path, name: str) -> SidePaths:
    """Return where `make_certificates` writes the files with which a client of that name dials the cloud."""
    return SidePaths(directory / "server-ca.pem", directory / f"{name}.pem", directory / f"{name}.key")


def make_certificates(
    directory: Path,
    *,
    robot: str,
    host_names: Sequence[str],
    now: datetime.datetime,
    days: int = 30,
    clients: Sequence[str] = (),
) -> CertificatePaths:
    """Make new certificates for both sides and write them to `directory`, replacing older ones.

    The keys of the two authorities are not written, so nothing more can be signed with them. Another certificate
    needs a whole new set.

    Args:
        directory: made if missing, accessible to the owner only.
        robot: the robot's name.
        host_names: DNS names and IP addresses by which the robot dials the cloud.
        now: the current time, with its time zone.
        days: how long they are valid.
        clients: names of further clients that the cloud shall accept, such as an observer; see `client_paths`.

    Raises:
        CertificateError: a name is not usable.
        OSError: the files cannot be written.
    """
    made = build_certificates(robot=robot, host_names=host_names, now=now, days=days)
    directory.mkdir(mode=0o700, parents=True, exist_ok=True)
    paths = CertificatePaths(
        robot=client_paths(directory, "robot"),
        cloud=SidePaths(directory / "client-ca.pem", directory / "cloud.pem", directory / "cloud.key"),
    )
    for side, ca, own in (
        (paths.robot, made.server_ca, made.robot),
        (paths.cloud, made.client_ca, made.cloud),
    ):
        _write(side.ca, ca.certificate, mode=0o644)
        _write(side.certificate, own.certificate, mode=0o644)
        _write(side.private_key, own.private_key, mode=0o600)
    for name in clients:
        client, own = client_paths(directory, name), issue_robot(made.client_ca, robot=name, now=now, days=days)
        _write(client.certificate, own.certificate, mode=0o644)
        _write(client.private_key, own.private_key, mode=0o600)
    return paths


def _write(path: Path, content: bytes, *, mode: int) -> None:
    """Replace the file atomically, so that half a key is never read, and never with wider permissions in between."""
    fresh = path.with_name(path.name + ".new")
    fresh.unlink(missing_ok=True)
    descriptor = os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
    with os.fdopen(descriptor, "wb") as file:
        file.write(content)
    fresh.replace(path)
