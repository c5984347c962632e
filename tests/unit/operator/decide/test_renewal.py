"""The robot's own key: who gets a certificate for it, and who does not."""

from __future__ import annotations

import base64
import datetime
from typing import Any

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID

from robot_offload.decide import renewal
from robot_offload.decide.certificates import RENEWED, ROLES, Issued, issue
from robot_offload.objects.parent import Parent
from robot_offload.render import pki
from tests.unit.operator.decide.worlds import FACTS, NOW, offload

DAY = datetime.timedelta(days=1)
PARENT = Parent(offload(), FACTS)


class Robot:
    """A robot that holds a certificate with its key."""

    def __init__(self, certificate: bytes, key: ec.EllipticCurvePrivateKey) -> None:
        self.certificate = x509.load_pem_x509_certificate(certificate)
        self.key = key
        self.next = ec.generate_private_key(ec.SECP256R1())

    @classmethod
    def with_bundle(cls, issued: Issued) -> Robot:
        """Has what a bundle written now holds."""
        data = issued.secrets[ROLES.index("robot")]["data"]
        key = serialization.load_pem_private_key(base64.b64decode(data["tls.key"]), password=None)
        assert isinstance(key, ec.EllipticCurvePrivateKey)
        return cls(base64.b64decode(data["tls.crt"]), key)

    def asks(self, proved_by: ec.EllipticCurvePrivateKey | None = None, prefix: bytes = renewal.PROVED) -> str:
        """Returns a request for the next key."""
        subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "admin")])  # what it asks to be called is nothing
        asked = x509.CertificateSigningRequestBuilder().subject_name(subject).sign(self.next, hashes.SHA256())
        der = asked.public_bytes(serialization.Encoding.DER)
        proof = (proved_by or self.key).sign(prefix + der, ec.ECDSA(hashes.SHA256()))
        parts = (der, self.certificate.public_bytes(serialization.Encoding.DER), proof)
        return ".".join(base64.b64encode(part).decode() for part in parts)

    def takes(self, issued: Issued) -> Robot:
        """Returns the robot with its new certificate."""
        assert issued.answer is not None
        assert issued.answer.certificate, issued.answer
        return Robot(issued.answer.certificate.encode(), self.next)


def again(before: Issued | None, request: str = "", now: datetime.datetime = NOW, revoke: str = "") -> Issued:
    live = dict(zip(ROLES, before.secrets, strict=True)) if before else {}
    return issue(PARENT, live, revoke, now, request)


def refused(issued: Issued) -> str:
    assert issued.answer is not None
    assert not issued.answer.certificate
    return issued.answer.reason


def made(issued: Issued) -> dict[str, str]:
    return {role: why.reason for role, why in issued.made}


def test_a_robot_gets_a_certificate_for_a_key_that_never_left_it() -> None:
    first = again(None)
    robot = Robot.with_bundle(first)
    signed = again(first, robot.asks())
    own = robot.takes(signed)
    assert own.certificate.public_key() == robot.next.public_key()
    assert own.certificate.subject.rfc4514_string() == "CN=walker"
    assert own.certificate.not_valid_after_utc == NOW + 90 * DAY
    usage = own.certificate.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value
    assert list(usage) == [x509.ExtendedKeyUsageOID.CLIENT_AUTH]
    client = x509.load_pem_x509_certificate(base64.b64decode(first.secrets[1]["data"]["tls.crt"]))
    own.certificate.verify_directly_issued_by(client)


def test_a_bundle_is_good_for_one_key_and_the_next_bundle_for_another() -> None:
    first = again(None)
    signed = again(first, Robot.with_bundle(first).asks())
    assert made(signed) == {"robot": "Used"}
    assert refused(again(signed, Robot.with_bundle(first).asks())) == "AlreadyRenewed"  # a copy of the bundle
    Robot.with_bundle(signed).takes(again(signed, Robot.with_bundle(signed).asks()))


def test_an_answer_that_was_lost_is_given_again() -> None:
    first = again(None)
    robot = Robot.with_bundle(first)
    signed = again(first, robot.asks())
    repeated = again(signed, robot.asks(), now=NOW + DAY)
    assert repeated.answer is not None
    assert signed.answer is not None
    assert repeated.answer.certificate == signed.answer.certificate
    assert repeated.secrets == signed.secrets


def test_a_robot_renews_for_years_with_its_last_key_and_nothing_grows() -> None:
    issued = again(None)
    bundle = Robot.with_bundle(issued)
    issued = again(issued, bundle.asks())
    robot = bundle.takes(issued)
    now = NOW
    for _ in range(20):
        now += 60 * DAY
        issued = again(issued, robot.asks(), now)
        robot = robot.takes(issued)
    assert robot.certificate.not_valid_after_utc == now + 90 * DAY
    assert len(str(issued.secrets[ROLES.index("robot")]["metadata"]["annotations"])) < 400


def test_a_copied_key_renews_once_and_then_the_robot_says_so() -> None:
    first = again(None)
    bundle = Robot.with_bundle(first)
    issued = again(first, bundle.asks())
    robot = bundle.takes(issued)
    thief = Robot(robot.certificate.public_bytes(serialization.Encoding.PEM), robot.key)
    stolen = again(issued, thief.asks(), NOW + 50 * DAY)
    assert stolen.answer is not None
    assert stolen.answer.reason == renewal.ISSUED
    assert refused(again(stolen, robot.asks(), NOW + 60 * DAY)) == "AlreadyRenewed"


def test_revoking_ends_what_was_signed_for_own_keys() -> None:
    first = again(None)
    bundle = Robot.with_bundle(first)
    issued = again(first, bundle.asks())
    robot = bundle.takes(issued)
    revoked = again(issued, robot.asks(), NOW + 60 * DAY, revoke="now")
    assert refused(revoked) == "OtherAuthority"
    assert RENEWED not in revoked.secrets[ROLES.index("robot")]["data"]


def _another_robot() -> str:
    other = issue(Parent(offload(), FACTS), {}, "", NOW)
    return Robot.with_bundle(other).asks()


@pytest.mark.parametrize(
    ("request_of", "reason"),
    [
        (lambda robot: "", None),
        (lambda robot: "no request", "RequestUnreadable"),
        (lambda robot: "AAAA.AAAA.AAAA", "RequestUnreadable"),
        (lambda robot: robot.asks() + "!", "RequestUnreadable"),
        (lambda robot: "a" * 100_000, "RequestUnreadable"),
        (lambda robot: robot.asks(proved_by=robot.next), "NoProof"),
        (lambda robot: robot.asks(prefix=b""), "NoProof"),
        (lambda robot: _another_robot(), "OtherAuthority"),
    ],
)
def test_who_cannot_prove_the_present_key_gets_nothing(request_of: Any, reason: str | None) -> None:
    first = again(None)
    issued = again(first, request_of(Robot.with_bundle(first)))
    assert (issued.answer.reason if issued.answer else None) == reason
    assert issued.secrets == first.secrets


def test_keys_of_another_kind_are_refused() -> None:
    first = again(None)
    robot = Robot.with_bundle(first)
    robot.next = ec.generate_private_key(ec.SECP384R1())
    assert refused(again(first, robot.asks())) == "RequestUnreadable"
    robot.next = robot.key
    assert refused(again(first, robot.asks())) == "RequestUnreadable"


def test_an_ended_certificate_and_one_that_is_hardly_used_renew_nothing() -> None:
    first = again(None)
    bundle = Robot.with_bundle(first)
    assert refused(again(first, bundle.asks(), NOW + 91 * DAY)) == "Expired"
    issued = again(first, bundle.asks())
    robot = bundle.takes(issued)
    assert refused(again(issued, robot.asks(), NOW + 30 * DAY)) == "TooEarly"


def test_certificates_for_other_robots_are_not_signed_by_name() -> None:
    first = again(None)
    authority = first.secrets[ROLES.index("client-ca")]["data"]
    pair = pki.KeyPair(base64.b64decode(authority["tls.crt"]), base64.b64decode(authority["tls.key"]))
    other = pki.issue_robot(pair, robot="runner", now=NOW, days=90)
    key = serialization.load_pem_private_key(other.private_key, password=None)
    assert isinstance(key, ec.EllipticCurvePrivateKey)
    assert refused(again(first, Robot(other.certificate, key).asks())) == "OtherRobot"
