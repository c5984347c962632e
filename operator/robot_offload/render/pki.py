"""Builds the certificates of one RobotOffload: no files, no clock; only the keys are random.

Each RobotOffload has two authorities of its own. The server authority signs the cloud's certificate, and the robot
trusts only it; the client authority signs the robot's certificate, and the cloud trusts only it. So a robot's key can
never pass for a cloud, and revoking a robot (a new client authority) does not change what robots trust.

All keys are ECDSA on P-256, in PKCS #8; every certificate begins an hour early, because robots' clocks are often
slow.
"""

from __future__ import annotations

import datetime
import ipaddress
import re
from collections.abc import Sequence
from dataclasses import dataclass

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from robot_offload.errors import InputError

PEM = serialization.Encoding.PEM
DER = serialization.Encoding.DER
BACKDATE = datetime.timedelta(hours=1)
"""How much earlier than its creation a certificate is valid."""

_ROBOT_NAME = re.compile(r"[A-Za-z0-9]([A-Za-z0-9._-]{0,61}[A-Za-z0-9])?")
_DNS_LABEL = r"[A-Za-z0-9]([A-Za-z0-9-]{0,61}[A-Za-z0-9])?"
_DNS_NAME = re.compile(rf"(?=.{{1,253}}$){_DNS_LABEL}(\.{_DNS_LABEL})*")


class CertificateError(InputError, ValueError):
    """Certificates cannot be made from this input."""


@dataclass(frozen=True)
class KeyPair:
    """A certificate and its private key, both PEM.

    Attributes:
        certificate: may be public.
        private_key: PKCS #8, not encrypted: its holder can act as the certificate's subject.
    """

    certificate: bytes
    private_key: bytes

    def __repr__(self) -> str:
        return "KeyPair(...)"  # a private key must not be logged


@dataclass(frozen=True)
class CertificateSet:
    """All certificates of one RobotOffload.

    Attributes:
        server_ca: signs the cloud's certificate; trusted by the robot.
        client_ca: signs the robot's certificate; trusted by the cloud.
        cloud: the cloud agent's, for TLS servers only.
        robot: the robot agent's, for TLS clients only.
    """

    server_ca: KeyPair
    client_ca: KeyPair
    cloud: KeyPair
    robot: KeyPair


def build_certificates(
    *, robot: str, host_names: Sequence[str], now: datetime.datetime, days: int = 30
) -> CertificateSet:
    """Build both authorities and both leaf certificates.

    Args:
        robot: the robot's name, the common name of its certificate.
        host_names: DNS names and IP addresses at which the robot dials the cloud.
        now: the present, with its time zone.
        days: validity of all of them.

    Raises:
        CertificateError: a name is invalid, none is given, or `now` has no time zone.
    """
    server_ca = build_authority(f"{robot} server authority", now=now, days=days)
    client_ca = build_authority(f"{robot} client authority", now=now, days=days)
    return CertificateSet(
        server_ca=server_ca,
        client_ca=client_ca,
        cloud=issue_cloud(server_ca, host_names=host_names, now=now, days=days),
        robot=issue_robot(client_ca, robot=robot, now=now, days=days),
    )


def build_authority(name: str, *, now: datetime.datetime, days: int) -> KeyPair:
    """Build a self-signed authority that may sign only leaf certificates.

    Args:
        name: common name in the subject. Informational only.
        now: the present, with its time zone.
        days: its validity.

    Raises:
        CertificateError: `now` has no time zone, or `days` is less than 1.
    """
    key = ec.generate_private_key(ec.SECP256R1())
    # The subject must distinguish authorities of different robots; X.520 limits a common name to 64
    # characters.
    subject = x509.Name(
        [
            x509.NameAttribute(NameOID.ORGANIZATION_NAME, "Robot Offload"),
            x509.NameAttribute(NameOID.COMMON_NAME, name[-64:]),
        ]
    )
    builder = (
        _builder(subject, key.public_key(), now=now, days=days)
        .issuer_name(subject)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(_usage(signs_certificates=True), critical=True)
    )
    return _pair(builder.sign(key, hashes.SHA256()), key)


def issue_cloud(authority: KeyPair, *, host_names: Sequence[str], now: datetime.datetime, days: int) -> KeyPair:
    """Build the cloud agent's certificate, for TLS servers only.

    Args:
        authority: the server authority.
        host_names: DNS names and IP addresses of the cloud; the robot checks the one it dials.
        now: the present, with its time zone.
        days: its validity, never longer than the authority's.

    Raises:
        CertificateError: no host name, or one that is neither a DNS name nor an IP address.
    """
    if not host_names:
        raise CertificateError("the cloud's certificate needs at least one DNS name or IP address to be dialled by")
    names = x509.SubjectAlternativeName([_general_name(name) for name in host_names])
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "cloud")])
    return _leaf(authority, subject, ExtendedKeyUsageOID.SERVER_AUTH, names, now=now, days=days)


def issue_robot(authority: KeyPair, *, robot: str, now: datetime.datetime, days: int) -> KeyPair:
    """Build the robot agent's certificate, for TLS clients only, with the robot's name as its common name.

    Args:
        authority: the client authority.
        robot: the robot's name.
        now: the present, with its time zone.
        days: its validity, never longer than the authority's.

    Raises:
        CertificateError: the name is invalid.
    """
    if not _ROBOT_NAME.fullmatch(robot):
        raise CertificateError(
            f"robot name {robot!r}: use up to 63 letters, digits, '.', '_' and '-', "
            "beginning and ending with a letter or digit"
        )
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, robot)])
    return _leaf(authority, subject, ExtendedKeyUsageOID.CLIENT_AUTH, None, now=now, days=days)


def certify_robot(
    authority: KeyPair, public_key: ec.EllipticCurvePublicKey, *, robot: str, now: datetime.datetime, days: int
) -> bytes:
    """Build a certificate for a key that the robot made itself; return it as PEM.

    Args:
        authority: the client authority.
        public_key: the robot's, with proven possession.
        robot: the robot's name.
        now: the present, with its time zone.
        days: its validity, never longer than the authority's.
    """
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, robot)])
    certificate = _sign(authority, public_key, subject, ExtendedKeyUsageOID.CLIENT_AUTH, None, now=now, days=days)
    return certificate.public_bytes(PEM)


def _leaf(
    authority: KeyPair,
    subject: x509.Name,
    purpose: x509.ObjectIdentifier,
    names: x509.SubjectAlternativeName | None,
    *,
    now: datetime.datetime,
    days: int,
) -> KeyPair:
    key = ec.generate_private_key(ec.SECP256R1())
    return _pair(_sign(authority, key.public_key(), subject, purpose, names, now=now, days=days), key)


def _sign(
    authority: KeyPair,
    public_key: ec.EllipticCurvePublicKey,
    subject: x509.Name,
    purpose: x509.ObjectIdentifier,
    names: x509.SubjectAlternativeName | None,
    *,
    now: datetime.datetime,
    days: int,
) -> x509.Certificate:
    issuer = x509.load_pem_x509_certificate(authority.certificate)
    issuer_key = serialization.load_pem_private_key(authority.private_key, password=None)
    assert isinstance(issuer_key, ec.EllipticCurvePrivateKey)
    builder = (
        _builder(subject, public_key, now=now, days=days, latest=issuer.not_valid_after_utc)
        .issuer_name(issuer.subject)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_usage(signs_certificates=False), critical=True)
        .add_extension(x509.ExtendedKeyUsage([purpose]), critical=False)
        .add_extension(x509.AuthorityKeyIdentifier.from_issuer_public_key(issuer_key.public_key()), critical=False)
    )
    if names is not None:
        builder = builder.add_extension(names, critical=False)
    return builder.sign(issuer_key, hashes.SHA256())


def _builder(
    subject: x509.Name,
    public_key: ec.EllipticCurvePublicKey,
    *,
    now: datetime.datetime,
    days: int,
    latest: datetime.datetime | None = None,
) -> x509.CertificateBuilder:
    if now.tzinfo is None:
        raise CertificateError("the present must be given with its time zone")
    if days < 1:
        raise CertificateError(f"certificates must be valid for at least 1 day, found {days}")
    end = now + datetime.timedelta(days=days)
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .public_key(public_key)
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - BACKDATE)
        .not_valid_after(min(end, latest) if latest else end)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(public_key), critical=False)
    )


def _usage(*, signs_certificates: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not signs_certificates,
        key_cert_sign=signs_certificates,
        crl_sign=signs_certificates,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        encipher_only=False,
        decipher_only=False,
    )


def _general_name(name: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(name))
    except ValueError:
        pass
    if not _DNS_NAME.fullmatch(name):
        raise CertificateError(f"{name!r} is neither a DNS name nor an IP address; write it without port and slashes")
    return x509.DNSName(name)


def _pair(certificate: x509.Certificate, key: ec.EllipticCurvePrivateKey) -> KeyPair:
    return KeyPair(
        certificate=certificate.public_bytes(PEM),
        private_key=key.private_bytes(PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()),
    )
