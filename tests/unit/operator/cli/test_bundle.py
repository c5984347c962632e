"""What `bundle` waits for, and what it says at the end."""

from __future__ import annotations

import base64
import dataclasses
from pathlib import Path
from typing import Any

import pytest

from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload.cli.bundle.command import (
    Material,
    facts_of,
    revocation_pending,
    secrets_of,
    told,
    trusted_by,
    waiting_for,
)
from robot_offload.cli.own_images import default_images, images_in_use
from robot_offload.decide.certificates import REVOKE, REVOKED
from robot_offload.errors import RobotOffloadError
from robot_offload.insight.observed import observe
from robot_offload.objects.parent import Parent
from robot_offload.render.bundle import PRIVATE_KEY, BundleSecrets, bundle
from robot_offload.render.pki import CertificateSet, build_certificates
from tests.unit.operator.cli.resources import NOW, manifest

SET = build_certificates(robot="wheelchair-7", host_names=["cloud.example"], now=NOW, days=90)
SECRETS = BundleSecrets(SET.server_ca.certificate, SET.robot.certificate, SET.robot.private_key)


def material(values: dict[str, Any] | None = None, **changes: Any) -> Material:
    live = manifest() if values is None else values
    offload = parse_object(live, "test", unknown="ignore", rules=())
    return dataclasses.replace(Material(observe(live), offload, SECRETS, revoking=False), **changes)


def test_with_addresses_and_certificates_there_is_nothing_to_wait_for() -> None:
    assert waiting_for(material()) == ("", "")


def test_an_address_that_is_missing_is_named() -> None:
    values = manifest()
    values["status"]["endpoints"] = values["status"]["endpoints"][2:]
    assert waiting_for(material(values)) == (
        "AddressPending",
        "the cluster has given no address yet for pulse, data",
    )


def test_certificates_are_waited_for_and_old_ones_are_not_given_out_after_a_revocation() -> None:
    assert waiting_for(material(secrets=None))[0] == "CertificatesPending"
    assert waiting_for(material(revoking=True))[0] == "CertificatesPending"


def test_the_operator_must_have_seen_the_last_change() -> None:
    values = manifest()
    values["metadata"]["generation"] = 4
    assert waiting_for(material(values))[0] == "InProgress"


def test_an_invalid_specification_is_not_waited_for() -> None:
    values = manifest(SpecValid=("False", "DuplicateOutput", "x"))
    with pytest.raises(RobotOffloadError, match="kubectl offload explain wheelchair-7"):
        waiting_for(material(values))


def test_a_secret_counts_when_it_is_complete() -> None:
    data = {
        "ca.crt": SECRETS.ca,
        "tls.crt": SECRETS.certificate,
        "tls.key": SECRETS.private_key,
    }
    encoded = {key: base64.b64encode(value).decode() for key, value in data.items()}
    assert secrets_of({"data": encoded}) == SECRETS
    assert secrets_of(None) is None
    for key in encoded:
        assert secrets_of({"data": {**encoded, key: ""}}) is None


def test_a_revocation_is_pending_until_the_clouds_secret_answers_it() -> None:
    asked = {"metadata": {"annotations": {REVOKE: "2026-11-21T10:00:00Z"}}}
    old = {"metadata": {"annotations": {REVOKED: "2026-01-01T00:00:00Z"}}}
    answer = {"metadata": {"annotations": {REVOKED: "2026-11-21T10:00:00Z"}}}
    assert revocation_pending(asked, None)
    assert revocation_pending(asked, old)
    assert not revocation_pending(asked, answer)
    assert not revocation_pending({"metadata": {}}, None)


def test_the_end_names_the_key_the_date_and_the_next_step() -> None:
    found = material()
    files = bundle(Parent(found.offload, facts_of(found)), found.secrets)
    lines = told(found, Path("out"), "/etc/robot-offload/wheelchair-7", files)
    assert lines[0] == f"out: the bundle of wheelchair-7, generation 3, {len(files) + 1} files"
    assert lines[1] == "The robot's certificate ends on 2027-02-19; write the bundle again before."
    assert lines[2].startswith(f"out/{PRIVATE_KEY} is secret")
    assert lines[3].startswith("Next: copy the folder to /etc/robot-offload/wheelchair-7")
    assert not any("BEGIN" in line for line in lines)


def test_images_are_those_that_run_and_else_those_of_this_version() -> None:
    agent = {"spec": {"template": {"spec": {"containers": [{"name": "agent", "image": "mine:1"}]}}}}
    assert images_in_use([agent]) == dataclasses.replace(default_images(), agent="mine:1")
    assert images_in_use([]) == default_images()


def test_a_certificate_of_the_authority_before_is_not_handed_out() -> None:
    old, new = (build_certificates(robot="wheelchair-7", host_names=["cloud"], now=NOW) for _ in range(2))
    secrets = BundleSecrets(b"", old.robot.certificate, b"")

    def cloud(made: CertificateSet) -> dict[str, Any]:
        return {"data": {"ca.crt": base64.b64encode(made.client_ca.certificate).decode()}}

    assert trusted_by(cloud(old), secrets)
    assert not trusted_by(cloud(new), secrets)
    assert not trusted_by(None, secrets)
