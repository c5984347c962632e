"""The robot's own key: whether a certificate is signed for it. Pure; only serial numbers are random.

The robot makes a key, sends a request through its data session, and proves it with the key that it already has: that
of its bundle, or its last own one. So neither the cloud's agent nor another writer of the robot's Lease can do so.
Each certificate is good for one such request. If a copy of it was used first, the robot's own request is refused and
the condition CertificateCurrent reports it. The reasons are in docs/decisions/0011-certificates-by-the-robot.md.
"""

from __future__ import annotations

import base64
import binascii
import datetime
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID

from robot_offload.render import pki

PROVED: Final = b"robot-offload renewal\n"
"""Prefix of the request in what the robot signs, so that the signature has no other use."""
MAX_SPENT: Final = 16
"""Certificates that may be remembered as used; each is forgotten at its end."""
ISSUED: Final = "Issued"


class RequestError(ValueError):
    """A text that is not a renewal request."""


@dataclass(frozen=True, slots=True)
class Request:
    """A robot's request.

    Attributes:
        digest: names the request in its answer.
        signing_request: holds the new public key.
        presented: the certificate that the robot has.
        proof: signature of `PROVED` and the signing request with the key of `presented`.
    """

    digest: str
    signing_request: x509.CertificateSigningRequest
    presented: x509.Certificate
    proof: bytes


@dataclass(frozen=True, slots=True)
class Answer:
    """The answer to a request.

    Attributes:
        digest: of the request.
        reason: `ISSUED`, or why not, as one CamelCase word.
        message: for people, with the next step.
        certificate: PEM; empty: refused.
    """

    digest: str
    reason: str
    message: str
    certificate: str = ""

    def text(self) -> str:
        """Return the answer as the robot reads it."""
        fields = {"request": self.digest, "reason": self.reason, "message": self.message}
        return json.dumps({**fields, "certificate": self.certificate})


@dataclass(frozen=True, slots=True)
class Signer:
    """The signing authority, and the certificates signed before.

    Attributes:
        authority: the client authority.
        robot: the robot's name.
        days: validity of a certificate.
        bundled: the serial number of the certificate in the bundle: its key has travelled, so it may be
            replaced at once.
        newest: the last certificate signed for a robot's own key; None: none yet.
        spent: serial numbers of certificates used in a request, and when each of them ends.
    """

    authority: pki.KeyPair
    robot: str
    days: int
    bundled: int
    newest: x509.Certificate | None
    spent: Mapping[int, datetime.datetime]


def digest(text: str) -> str:
    """Return the name of a request in its answer."""
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def read_request(text: str) -> Request:
    """Read a request: three parts in base64, joined by points.

    Raises:
        RequestError: the text is not a request.
    """
    try:
        asked, presented, proof = (base64.b64decode(part, validate=True) for part in text.split("."))
        request = Request(digest(text), x509.load_der_x509_csr(asked), x509.load_der_x509_certificate(presented), proof)
        keys = request.signing_request.public_key(), request.presented.public_key()
        signed = request.signing_request.is_signature_valid
    except (ValueError, TypeError, binascii.Error, InvalidSignature) as error:
        raise RequestError(f"the robot's request cannot be read: {error}") from error
    except Exception as error:  # cryptography raises further errors for odd keys and algorithms
        raise RequestError(f"the robot's request cannot be read: {type(error).__name__}: {error}") from error
    if not all(isinstance(key, ec.EllipticCurvePublicKey) and key.curve.name == "secp256r1" for key in keys):
        raise RequestError("the robot's request is for another kind of key than ECDSA on P-256")
    if not signed or keys[0] == keys[1]:
        raise RequestError("the robot's request is not for a new key of its own")
    return request


def answer(text: str, signer: Signer, now: datetime.datetime) -> Answer:
    """Decide about a request, and sign.

    Args:
        text: the request, unparsed.
        signer: the signing authority.
        now: our wall clock, with its time zone.
    """
    try:
        request = read_request(text)
    except RequestError as error:
        return Answer(digest(text), "RequestUnreadable", f"{error}; install the same release on both sides")
    if problem := _foreign(request, signer, now):
        return Answer(request.digest, *problem)
    key = request.signing_request.public_key()
    assert isinstance(key, ec.EllipticCurvePublicKey)
    if signer.newest is not None and signer.newest.public_key() == key:
        pem = signer.newest.public_bytes(pki.PEM).decode()  # the answer was lost: repeat it
        return Answer(request.digest, ISSUED, "The robot has a certificate for its own key", pem)
    if problem := _not_now(request, signer, now):
        return Answer(request.digest, *problem)
    pem = pki.certify_robot(signer.authority, key, robot=signer.robot, now=now, days=signer.days).decode()
    return Answer(request.digest, ISSUED, "The robot has a certificate for its own key", pem)


def spent_after(request: Request, signer: Signer, now: datetime.datetime) -> dict[int, datetime.datetime]:
    """Return the certificates that count as used after a request was granted, without those that have ended."""
    used = {**signer.spent, request.presented.serial_number: request.presented.not_valid_after_utc}
    return {serial: end for serial, end in used.items() if end > now}


def _foreign(request: Request, signer: Signer, now: datetime.datetime) -> tuple[str, str] | None:
    """Return why the requester does not hold a certificate of this robot, or None."""
    presented = request.presented
    try:
        presented.verify_directly_issued_by(x509.load_pem_x509_certificate(signer.authority.certificate))
    except (ValueError, TypeError, InvalidSignature):
        return "OtherAuthority", "The robot's certificate was revoked or is another robot's; write its bundle again"
    names = [part.value for part in presented.subject.get_attributes_for_oid(NameOID.COMMON_NAME)]
    if names != [signer.robot]:
        return "OtherRobot", "The certificate names another robot; write the bundle again"
    if presented.not_valid_after_utc <= now:
        return "Expired", "The robot's certificate has ended; write its bundle again"
    key = presented.public_key()
    assert isinstance(key, ec.EllipticCurvePublicKey)
    proved = PROVED + request.signing_request.public_bytes(pki.DER)
    try:
        key.verify(request.proof, proved, ec.ECDSA(hashes.SHA256()))
    except InvalidSignature:
        return "NoProof", "The request was not signed with the robot's key; look who writes the robot's Lease"
    return None


def _not_now(request: Request, signer: Signer, now: datetime.datetime) -> tuple[str, str] | None:
    """Return why the holder of a certificate may not get another one (asked before, too early, too often), or None."""
    presented = request.presented
    if presented.serial_number in signer.spent:
        message = (
            "This certificate has been renewed with another key: a copy of it is in use, or the robot has lost its "
            "state. Revoke it when in doubt (`kubectl offload revoke`), and write the bundle again"
        )
        return "AlreadyRenewed", message
    begin, end = presented.not_valid_before_utc, presented.not_valid_after_utc
    if presented.serial_number != signer.bundled and now < begin + (end - begin) / 2:
        return "TooEarly", "The robot's certificate is in the first half of its life; the robot's clock may be wrong"
    if len(spent_after(request, signer, now)) > MAX_SPENT:
        return "TooMany", "The robot's certificate was renewed too often of late; revoke it when in doubt"
    return None
