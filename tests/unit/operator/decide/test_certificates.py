"""The life of certificates: decided from what the Secrets hold now."""

from __future__ import annotations

import base64
import datetime
from typing import Any

import pytest
from cryptography import x509

from robot_offload.decide.authorities import AUTHORITIES, serves
from robot_offload.decide.certificates import REVOKED, ROLES, Issued, content_hash, issue
from robot_offload.objects.parent import Parent
from tests.unit.operator.decide.worlds import FACTS, NOW, offload

DAY = datetime.timedelta(days=1)


def again(
    before: Issued | None = None, revoke: str = "", now: datetime.datetime = NOW, without: str = "", **spec: Any
) -> Issued:
    """Decides again on what `before` left, less one Secret."""
    live = dict(zip(ROLES, before.secrets, strict=True)) if before else {}
    return issue(
        Parent(offload(**spec), FACTS), {role: secret for role, secret in live.items() if role != without}, revoke, now
    )


def made(issued: Issued) -> dict[str, str]:
    return {role: why.reason for role, why in issued.made}


def certificate(issued: Issued, role: str) -> x509.Certificate:
    secret = issued.secrets[ROLES.index(role)]  # type: ignore[arg-type]
    return x509.load_pem_x509_certificate(base64.b64decode(secret["data"]["tls.crt"]))


def test_at_first_everything_is_made_and_then_nothing_more() -> None:
    first = again()
    assert set(made(first)) == set(ROLES)
    second = again(first)
    assert made(second) == {}
    assert second.secrets == first.secrets
    assert [secret["metadata"]["name"] for secret in first.leaves] == ["walker-cloud", "walker-robot"]


def test_keys_that_sign_further_ones_are_in_the_operators_namespace_and_only_there() -> None:
    issued = again()
    assert {secret["metadata"]["namespace"] for secret in issued.authorities} == {FACTS.home}
    for secret, role in zip(issued.authorities, AUTHORITIES, strict=True):
        assert secret["metadata"]["name"] == f"{role}-{FACTS.uid}"
        assert serves(secret) == (FACTS.namespace, "walker")
        assert "ownerReferences" not in secret["metadata"]  # none reaches into another namespace
    for secret in issued.leaves:
        found = x509.load_pem_x509_certificate(base64.b64decode(secret["data"]["tls.crt"]))
        assert not found.extensions.get_extension_for_class(x509.BasicConstraints).value.ca


def test_each_side_trusts_the_authority_of_the_other() -> None:
    secrets = dict(zip(ROLES, again().secrets, strict=True))
    assert secrets["cloud"]["data"]["ca.crt"] == secrets["client-ca"]["data"]["tls.crt"]
    assert secrets["robot"]["data"]["ca.crt"] == secrets["server-ca"]["data"]["tls.crt"]


@pytest.mark.parametrize(
    ("lost", "expected"),
    [
        ("server-ca", {"server-ca": "Missing", "cloud": "OtherAuthority"}),
        ("client-ca", {"client-ca": "Missing", "robot": "OtherAuthority"}),
        ("cloud", {"cloud": "Missing"}),
        ("robot", {"robot": "Missing"}),
    ],
)
def test_a_secret_that_is_missing_is_made_again_with_what_it_signed(lost: str, expected: dict[str, str]) -> None:
    assert made(again(again(), without=lost)) == expected


def test_leaves_are_renewed_before_they_end_and_authorities_stay() -> None:
    first = again()
    assert made(again(first, now=NOW + 59 * DAY)) == {}
    renewed = again(first, now=NOW + 61 * DAY)
    assert made(renewed) == {"cloud": "Expiring", "robot": "Expiring"}
    assert certificate(renewed, "robot").not_valid_after_utc == NOW + (61 + 90) * DAY
    certificate(renewed, "robot").verify_directly_issued_by(certificate(first, "client-ca"))


def test_the_next_look_is_due_when_the_first_one_is_to_be_renewed() -> None:
    assert again().recheck_s == pytest.approx(60 * 86_400)


def test_revoking_makes_a_client_authority_and_the_robots_certificate_once_for_each_request() -> None:
    first = again()
    revoked = again(first, revoke="monday")
    assert made(revoked) == {"client-ca": "Revoked", "robot": "OtherAuthority"}
    for secret in (revoked.secrets[1], revoked.secrets[2]):  # the operator's, and what the command line looks at
        assert secret["metadata"]["annotations"][REVOKED] == "monday"
    assert revoked.secrets[2]["data"]["ca.crt"] == revoked.secrets[1]["data"]["tls.crt"]
    assert made(again(revoked, revoke="monday")) == {}
    assert made(again(revoked, revoke="")) == {}
    assert made(again(revoked, revoke="tuesday")) == {"client-ca": "Revoked", "robot": "OtherAuthority"}


def test_a_crash_between_authority_and_leaf_is_finished_by_the_next_look() -> None:
    first, revoked = again(), again(again(), revoke="monday")
    half = dict(zip(ROLES, first.secrets, strict=True)) | {"client-ca": revoked.secrets[1]}
    finished = issue(Parent(offload(), FACTS), half, "monday", NOW)  # type: ignore[arg-type]
    assert made(finished) == {"robot": "OtherAuthority"}


def test_another_declared_host_is_another_certificate_of_the_cloud_only() -> None:
    transport = {"type": "Zenoh", "expose": {"host": "edge.example.org"}}
    changed = again(again(), transport=transport)
    assert made(changed) == {"cloud": "OtherHosts"}
    names = certificate(changed, "cloud").extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert names.get_values_for_type(x509.DNSName) == ["edge.example.org", "walker-udp.fleet.svc"]


@pytest.mark.parametrize("value", ["", "nonsense", base64.b64encode(b"nonsense").decode()])
def test_a_damaged_secret_counts_as_missing(value: str) -> None:
    first = again()
    live = dict(zip(ROLES, first.secrets, strict=True))
    damaged = {**live["cloud"], "data": {**live["cloud"]["data"], "tls.crt": value}}
    assert made(issue(Parent(offload(), FACTS), {**live, "cloud": damaged}, "", NOW)) == {"cloud": "Missing"}


def test_a_key_that_does_not_fit_its_certificate_counts_as_missing() -> None:
    first = again()
    live = dict(zip(ROLES, first.secrets, strict=True))
    mixed = {**live["cloud"], "data": {**live["cloud"]["data"], "tls.key": live["robot"]["data"]["tls.key"]}}
    assert made(issue(Parent(offload(), FACTS), {**live, "cloud": mixed}, "", NOW)) == {"cloud": "Missing"}


def test_the_hash_of_a_secret_follows_its_content_only() -> None:
    first = again()
    cloud = first.secrets[2]
    assert content_hash(cloud) == content_hash({**cloud, "metadata": {}})
    assert content_hash(cloud) != content_hash(first.secrets[3])
    assert content_hash(None) == ""
