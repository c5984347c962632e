"""Keys, requests and certificates by the `openssl` program, which every Ubuntu has; Python's `ssl` makes none."""

from __future__ import annotations

import ssl
import subprocess
from dataclasses import dataclass
from pathlib import Path

from robot_offload_agent.errors import AgentError

PROVED = b"robot-offload renewal\n"
"""Prefix of the signed request, so that the signature is valid for nothing else. The operator uses the same."""
WITHIN_S = 20.0
"""Time limit of one call. It takes some milliseconds; an overloaded machine may need seconds."""


class CertificateError(AgentError):
    """A key or certificate could not be made or read; the message names it."""


@dataclass(frozen=True)
class Certificate:
    """The content of a certificate.

    Attributes:
        serial: its serial number, lower-case hexadecimal without leading zeros.
        begin_s, end_s: its validity, seconds of the system clock.
    """

    serial: str
    begin_s: float
    end_s: float


def look(file: Path) -> Certificate:
    """Read the first certificate in a PEM file; raise CertificateError."""
    told = _run("x509", "-in", str(file), "-noout", "-serial", "-startdate", "-enddate").decode(errors="replace")
    fields = dict(line.partition("=")[::2] for line in told.splitlines())
    try:
        begin_s, end_s = (float(ssl.cert_time_to_seconds(fields[name])) for name in ("notBefore", "notAfter"))
        return Certificate(f"{int(fields['serial'], 16):x}", begin_s, end_s)
    except (KeyError, ValueError) as error:
        raise CertificateError(f"{file}: openssl says {told!r:.200}") from error


def make_key(file: Path) -> None:
    """Write a new private key that only its owner may read; raise CertificateError."""
    key = _run("genpkey", "-algorithm", "EC", "-pkeyopt", "ec_paramgen_curve:P-256")
    try:
        file.touch(mode=0o600)
        file.chmod(0o600)
        file.write_bytes(key)
    except OSError as error:
        raise CertificateError(f"{file}: {error.strerror}") from error


def signing_request(key: Path, name: str) -> bytes:
    """Return a request for a certificate of this key, DER; raise CertificateError."""
    return _run("req", "-new", "-key", str(key), "-subj", f"/CN={name}", "-outform", "DER")


def der(certificate: Path) -> bytes:
    """Return the first certificate of a PEM file as DER; raise CertificateError."""
    return _run("x509", "-in", str(certificate), "-outform", "DER")


def prove(key: Path, request: bytes) -> bytes:
    """Return the signature of a request with another key, as proof of possession; raise CertificateError."""
    return _run("dgst", "-sha256", "-sign", str(key), given=PROVED + request)


def belong_together(certificate: Path, key: Path) -> bool:
    """Return whether a private key belongs to a certificate."""
    try:
        ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT).load_cert_chain(certificate, key)
    except (OSError, ssl.SSLError):
        return False
    return True


def _run(*arguments: str, given: bytes = b"") -> bytes:
    try:
        done = subprocess.run(
            ["openssl", *arguments], input=given, capture_output=True, timeout=WITHIN_S, check=False
        )  # fmt: skip
    except FileNotFoundError as error:
        raise CertificateError("there is no program openssl on this robot; install the package openssl") from error
    except (OSError, subprocess.TimeoutExpired) as error:
        raise CertificateError(f"openssl {arguments[0]}: {error}") from error
    if done.returncode:
        lines = done.stderr.decode(errors="replace").strip().splitlines()
        raise CertificateError(f"openssl {arguments[0]}: {lines[0] if lines else f'ended with {done.returncode}'}")
    return done.stdout
