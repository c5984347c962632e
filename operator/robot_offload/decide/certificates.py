"""The life of one RobotOffload's certificates: issue, renew before they end, rotate when a robot is revoked.

Each Secret is decided from its present content. So a crash between two of them does no harm: the next pass finds what
is done. Authorities come first, then what they sign. Only keys are random here.

An authority lives ten years, because robots carry the server's in their bundle. Leaves live `certificates.duration` and
are renewed `renewBefore` their end. The robot's leaf is the one in its bundle: once connected, the robot makes its own
key and gets a certificate for that (`renewal`); then the leaf counts as used, and the next bundle has another one.
Revoking makes a new client authority at once: certificates that it did not sign are refused from then on.
"""

from __future__ import annotations

import base64
import datetime
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, Literal, TypeAlias

from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import serialization
from cryptography.x509.oid import NameOID

from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.decide import authorities, renewal
from robot_offload.decide.authorities import Authority
from robot_offload.decide.ownership import Key
from robot_offload.decide.verdicts import Verdict, no, yes
from robot_offload.kube.kinds import SECRET
from robot_offload.kube.port import Manifest
from robot_offload.objects import names
from robot_offload.objects.parent import Parent, Part
from robot_offload.render import pki

REVOKE: Final = "robotoffload.dev/revoke"
"""Annotation on the RobotOffload: new text in it requests a new client authority."""
REVOKED: Final = "robotoffload.dev/revoked"
"""Annotation on the Secrets of the client authority and of the cloud: the value of `REVOKE` that they answer."""
SPENT: Final = "robotoffload.dev/used-certificates"
"""Annotation on the robot's Secret: serial numbers of certificates used to get another one, with their ends."""
RENEWED: Final = "renewed.crt"
"""Entry of the robot's Secret: the last certificate signed for the robot's own key."""
AUTHORITY_DAYS: Final = 3650

Leaf: TypeAlias = Literal["cloud", "robot"]
LEAVES: Final[tuple[Leaf, ...]] = ("cloud", "robot")
Role: TypeAlias = Authority | Leaf
ROLES: Final[tuple[Role, ...]] = (*authorities.AUTHORITIES, *LEAVES)
"""In the order in which they are created."""


@dataclass(frozen=True, slots=True)
class Issued:
    """The wanted certificates, including those just made.

    Attributes:
        authorities: the Secrets for the operator's namespace, new and kept, in the order of `AUTHORITIES`.
        leaves: the Secrets beside the robot, in the order of `LEAVES`.
        made: those newly made, and why: (role, verdict).
        verdict: for the condition CertificatesReady.
        recheck_s: seconds until the first renewal.
        answer: to the robot's request for a certificate; None: there is no request.
    """

    authorities: tuple[Manifest, ...]
    leaves: tuple[Manifest, ...]
    made: tuple[tuple[Role, Verdict], ...]
    verdict: Verdict
    recheck_s: float
    answer: renewal.Answer | None = None

    @property
    def secrets(self) -> tuple[Manifest, ...]:
        """Return all Secrets in the order of `ROLES`."""
        return (*self.authorities, *self.leaves)


@dataclass(frozen=True, slots=True)
class _Own:
    """The certificates signed for the robot's own keys.

    Attributes:
        newest: the last certificate; None: none yet.
        spent: serial numbers of certificates used to get another one, and when each ends.
    """

    newest: x509.Certificate | None = None
    spent: Mapping[int, datetime.datetime] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class _Pair:
    """A certificate with its key, parsed."""

    pem: pki.KeyPair
    certificate: x509.Certificate
    trusted: bytes = b""
    annotations: Mapping[str, str] = field(default_factory=dict)


def secret_name(offload: str, role: Leaf) -> str:
    """Return the name of the Secret of a leaf."""
    return names.child_name(offload, role)


def secret_keys(offload: str) -> dict[Leaf, Key]:
    """Return the key of each leaf's Secret."""
    return {role: (SECRET, secret_name(offload, role)) for role in LEAVES}


def content_hash(secret: Manifest | None) -> str:
    """Return a short hash of a Secret's content; empty: there is no Secret."""
    data = (secret or {}).get("data") or {}
    text = "\0".join(f"{key}\0{data[key]}" for key in sorted(data))
    return hashlib.sha256(text.encode()).hexdigest()[:16] if data else ""


def issue(
    parent: Parent,
    live: Mapping[Role, Manifest | None],
    revoke: str,
    now: datetime.datetime,
    request: str = "",
) -> Issued:
    """Decide about all certificates and make the needed ones.

    Args:
        parent: a valid RobotOffload.
        live: our Secrets as they are.
        revoke: the text of the annotation `REVOKE`; empty: none.
        now: our wall clock, with its time zone.
        request: the robot's request, unparsed; empty: none.
    """
    settings = parent.spec.transport.certificates
    life = _Life(
        days=max(1, round(settings.duration_ms / 86_400_000)),
        margin=datetime.timedelta(milliseconds=settings.renew_before_ms),
        now=now,
    )
    name = parent.name
    have = {role: _read(live.get(role)) for role in ROLES}
    made: list[tuple[Role, Verdict]] = []

    def decide(role: Role, why: Verdict | None) -> bool:
        if why is not None:
            made.append((role, why))
        return why is not None

    server, client = have["server-ca"], have["client-ca"]
    if decide("server-ca", _unusable_authority(server, life)) or server is None:
        server = _pair(pki.build_authority(f"{name} server authority", now=now, days=AUTHORITY_DAYS))
    if decide("client-ca", _unusable_authority(client, life) or _revoked(client, revoke)) or client is None:
        client = _pair(pki.build_authority(f"{name} client authority", now=now, days=AUTHORITY_DAYS))
    hosts = host_names(parent.offload, parent.namespace)
    cloud, robot = have["cloud"], have["robot"]
    own, answer = _own(live.get("robot") or live.get("client-ca"), client), None
    if request:
        bundled = robot.certificate.serial_number if robot is not None else 0
        signer = renewal.Signer(client.pem, name, life.days, bundled, own.newest, own.spent)
        answer = renewal.answer(request, signer, now)
        own = _own_after(own, answer, request, signer, now)
    if decide("cloud", _unusable_leaf(cloud, server, life) or _other_hosts(cloud, hosts)) or cloud is None:
        cloud = _pair(pki.issue_cloud(server.pem, host_names=hosts, now=now, days=life.days))
    why = _unusable_leaf(robot, client, life) or _other_robot(robot, name) or _used(robot, own)
    if decide("robot", why) or robot is None:
        robot = _pair(pki.issue_robot(client.pem, robot=name, now=now, days=life.days))
    answered = revoke or client.annotations.get(REVOKED, "")
    noted = {REVOKED: answered} if answered else {}
    signing = (
        authorities.secret(parent, "server-ca", _data(server), _identity(server)),
        authorities.secret(parent, "client-ca", _data(client), {**noted, **_spent(own)}),
    )
    leaves = (
        _leaf_secret(parent, "cloud", cloud, {"ca.crt": client.pem.certificate}, noted),
        _robot_secret(parent, robot, server, own),
    )
    renewals = [life.renewal(pair.certificate) for pair in (server, client, cloud, robot)]
    recheck_s = max(60.0, (min(renewals) - now).total_seconds())
    return Issued(signing, leaves, tuple(made), _issued(cloud, robot, _identity(server)), recheck_s, answer)


def _issued(cloud: _Pair, robot: _Pair, identity: Mapping[str, str]) -> Verdict:
    earlier = "The robot's bundle of an earlier RobotOffload of this name stays good. " if identity else ""
    return yes(
        "Issued",
        f"{earlier}"
        f"The cloud's certificate ends on {_date(cloud)}, that for the robot's bundle on {_date(robot)}; "
        "CertificateCurrent is about the one that the robot uses",
    )


def ends(secret: Manifest | None) -> tuple[str, datetime.datetime] | None:
    """Return the serial number (hexadecimal) and the end of the certificate in a Secret; None: there is none."""
    pair = _read(secret)
    if pair is None:
        return None
    return f"{pair.certificate.serial_number:x}", pair.certificate.not_valid_after_utc


def shown(serial: str, not_after: datetime.datetime) -> dict[str, str]:
    """Return a certificate in the form of the status."""
    return {"serial": serial, "notAfter": not_after.astimezone(datetime.UTC).strftime("%Y-%m-%dT%H:%M:%SZ")}


def _own(secret: Manifest | None, client: _Pair) -> _Own:
    """Return the certificates signed for the robot's own keys by the present authority."""
    data = (secret or {}).get("data") or {}
    noted = ((secret or {}).get("metadata", {}).get("annotations") or {}).get(SPENT) or "{}"
    try:
        spent = {int(serial, 16): datetime.datetime.fromisoformat(end) for serial, end in json.loads(noted).items()}
    except (ValueError, TypeError, AttributeError):
        spent = {}
    try:
        newest = x509.load_pem_x509_certificate(base64.b64decode(data[RENEWED]))
        newest.verify_directly_issued_by(client.certificate)
    except (KeyError, ValueError, TypeError, InvalidSignature):
        return _Own(None, spent)
    return _Own(newest, spent)


def _own_after(own: _Own, answer: renewal.Answer, request: str, signer: renewal.Signer, now: datetime.datetime) -> _Own:
    """Return the same after an answer."""
    if not answer.certificate:
        return own
    newest = x509.load_pem_x509_certificate(answer.certificate.encode())
    return _Own(newest, renewal.spent_after(renewal.read_request(request), signer, now))


def _used(pair: _Pair | None, own: _Own) -> Verdict | None:
    if pair is not None and pair.certificate.serial_number in own.spent:
        return no("Used", "the robot has got a certificate for a key of its own with it")
    return None


def host_names(offload: RobotOffload, namespace: str) -> tuple[str, ...]:
    """Return the names in the cloud's certificate: the declared one, and the Service's own inside the cluster."""
    declared = offload.spec.transport.expose.host
    inside = f"{names.child_name(offload.metadata.name, names.UDP)}.{namespace}.svc"
    return (declared, inside) if declared else (inside,)


@dataclass(frozen=True, slots=True)
class _Life:
    """How long certificates live. Times are UTC."""

    days: int
    margin: datetime.timedelta
    now: datetime.datetime

    def renewal(self, certificate: x509.Certificate) -> datetime.datetime:
        """Return when to renew a certificate: `margin` before its end, not in the first half of a short life."""
        begin, end = certificate.not_valid_before_utc, certificate.not_valid_after_utc
        return max(end - self.margin, begin + (end - begin) / 2)

    def due(self, certificate: x509.Certificate) -> bool:
        """Return whether that time has come."""
        return self.now >= self.renewal(certificate)


def _unusable_authority(pair: _Pair | None, life: _Life) -> Verdict | None:
    if pair is None:
        return no("Missing", "there is no usable authority in the Secret")
    if life.due(pair.certificate):
        return no("Expiring", "the authority ends soon")
    return None


def _unusable_leaf(pair: _Pair | None, authority: _Pair, life: _Life) -> Verdict | None:
    if pair is None:
        return no("Missing", "there is no usable certificate in the Secret")
    try:
        pair.certificate.verify_directly_issued_by(authority.certificate)
    except (ValueError, TypeError, InvalidSignature):
        return no("OtherAuthority", "the certificate was signed by another authority")
    if life.due(pair.certificate):
        return no("Expiring", "the certificate ends soon")
    return None


def _revoked(pair: _Pair | None, revoke: str) -> Verdict | None:
    if pair is not None and revoke and pair.annotations.get(REVOKED) != revoke:
        return no("Revoked", f"the annotation {REVOKE} asks for a new client authority")
    return None


def _other_hosts(pair: _Pair | None, hosts: tuple[str, ...]) -> Verdict | None:
    if pair is None:
        return None
    try:
        names = pair.certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return no("OtherHosts", "the certificate names no host")
    found = {str(name.value) for name in names}
    return None if found == set(hosts) else no("OtherHosts", "the host's declared name has changed")


def _other_robot(pair: _Pair | None, name: str) -> Verdict | None:
    if pair is None:
        return None
    names = pair.certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    return None if [part.value for part in names] == [name] else no("OtherRobot", "the certificate names another robot")


def _read(secret: Manifest | None) -> _Pair | None:
    """Return the pair in a Secret; None: there is none, or certificate and key do not match."""
    data = (secret or {}).get("data") or {}
    try:
        pem = pki.KeyPair(base64.b64decode(data["tls.crt"]), base64.b64decode(data["tls.key"]))
        certificate = x509.load_pem_x509_certificate(pem.certificate)
        key = serialization.load_pem_private_key(pem.private_key, password=None)
        trusted = base64.b64decode(data.get("ca.crt") or "")
    except (KeyError, ValueError, TypeError):
        return None
    if key.public_key() != certificate.public_key():
        return None
    return _Pair(pem, certificate, trusted, (secret or {}).get("metadata", {}).get("annotations") or {})


def _pair(pem: pki.KeyPair) -> _Pair:
    return _Pair(pem, x509.load_pem_x509_certificate(pem.certificate))


def _robot_secret(parent: Parent, robot: _Pair, server: _Pair, own: _Own) -> Manifest:
    further = {RENEWED: own.newest.public_bytes(pki.PEM)} if own.newest is not None else {}
    noted = {**_spent(own), **_identity(server)}
    return _leaf_secret(parent, "robot", robot, {"ca.crt": server.pem.certificate, **further}, noted)


def _spent(own: _Own) -> dict[str, str]:
    """Return the annotation with the spent certificates; it is also on the authority, which lives longer."""
    spent = {f"{serial:x}": end.isoformat() for serial, end in sorted(own.spent.items())}
    return {SPENT: json.dumps(spent)} if spent else {}


def _identity(server: _Pair) -> dict[str, str]:
    """Return the annotation with the uid by which the robot knows its cloud, if that is an earlier RobotOffload's."""
    found = server.annotations.get(authorities.IDENTITY)
    return {authorities.IDENTITY: found} if found else {}


def _leaf_secret(
    parent: Parent, role: Leaf, pair: _Pair, further: Mapping[str, bytes], annotations: Mapping[str, str]
) -> Manifest:
    body: Manifest = {"type": "kubernetes.io/tls", "data": _data(pair, further)}
    return parent.child(SECRET, Part(secret_name(parent.name, role), "certificates"), body, annotations)


def _data(pair: _Pair, further: Mapping[str, bytes] | None = None) -> dict[str, str]:
    data = {"tls.crt": pair.pem.certificate, "tls.key": pair.pem.private_key, **(further or {})}
    return {key: base64.b64encode(value).decode() for key, value in data.items()}


def _date(pair: _Pair) -> str:
    return pair.certificate.not_valid_after_utc.strftime("%Y-%m-%d")
