"""The certificates of a cluster: one authority, P-256 keys, valid for a month."""

from __future__ import annotations

import datetime as dt
import ipaddress
from collections.abc import Sequence
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

LIFE = dt.timedelta(days=30)


class Authority:
    """Issues certificates into a directory: NAME.crt and NAME.key; its own is ca.crt."""

    def __init__(self, directory: Path, now: dt.datetime) -> None:
        self.directory = directory
        self._since = now - dt.timedelta(minutes=5)
        self._key = ec.generate_private_key(ec.SECP256R1())
        self._name = _name("robot-offload-test-ca")
        directory.mkdir(parents=True, mode=0o700)
        own = self._builder(self._name, self._key).add_extension(x509.BasicConstraints(ca=True, path_length=0), True)
        (directory / "ca.crt").write_bytes(_pem(own.sign(self._key, hashes.SHA256())))

    def client(self, name: str, user: str, groups: Sequence[str] = ()) -> None:
        """Issue a certificate that identifies a client of the API server as this user."""
        self._issue(name, _name(user, groups), x509.ExtendedKeyUsage([ExtendedKeyUsageOID.CLIENT_AUTH]))

    def server(self, name: str, addresses: Sequence[str], names: Sequence[str] = ()) -> None:
        """Issue a certificate for a server at these IP addresses and names."""
        places: list[x509.GeneralName] = [x509.IPAddress(ipaddress.ip_address(each)) for each in addresses]
        places += [x509.DNSName(each) for each in names]
        self._issue(name, _name(name), x509.SubjectAlternativeName(places))

    def _issue(self, name: str, subject: x509.Name, extension: x509.ExtensionType) -> None:
        key = ec.generate_private_key(ec.SECP256R1())
        certificate = self._builder(subject, key).add_extension(extension, False).sign(self._key, hashes.SHA256())
        (self.directory / f"{name}.crt").write_bytes(_pem(certificate))
        path = self.directory / f"{name}.key"
        path.touch(0o600)
        path.write_bytes(
            key.private_bytes(
                serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
            )
        )

    def _builder(self, subject: x509.Name, key: ec.EllipticCurvePrivateKey) -> x509.CertificateBuilder:
        builder = x509.CertificateBuilder(issuer_name=self._name, subject_name=subject, public_key=key.public_key())
        builder = builder.serial_number(x509.random_serial_number())
        return builder.not_valid_before(self._since).not_valid_after(self._since + LIFE)


def _name(common: str, organizations: Sequence[str] = ()) -> x509.Name:
    parts = [x509.NameAttribute(NameOID.ORGANIZATION_NAME, each) for each in organizations]
    return x509.Name([*parts, x509.NameAttribute(NameOID.COMMON_NAME, common)])


def _pem(certificate: x509.Certificate) -> bytes:
    return certificate.public_bytes(serialization.Encoding.PEM)
