"""The robot's requests, made with the real `openssl`, against the operator that signs them."""

from __future__ import annotations

import base64
import datetime
import json
import stat
from pathlib import Path

import pytest

from robot_offload.api.agent_state import parse_state
from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.decide import renewal as operator
from robot_offload.decide.certificates import ROLES, Issued, issue
from robot_offload.objects.parent import Parent
from robot_offload.render.bundle import BundleSecrets, bundle
from robot_offload.render.pki import build_certificates
from robot_offload_agent.certificates import openssl, renewal
from robot_offload_agent.certificates.wallet import Wallet, renews, with_own_certificate
from robot_offload_agent.link.choice import check_link
from robot_offload_agent.settings import liaison
from robot_offload_agent.settings.notes import Credential, RobotNotes, decode_robot, encode
from robot_offload_agent.settings.parameters import Configuration, load
from robot_offload_agent.tunnel import configuration as tunnel
from robot_offload_agent.tunnel.ends import context, newest
from tests.unit.operator.render.given import EVERY_ENDPOINT, TRANSPORTS, facts, offload

DAY = datetime.timedelta(days=1)
RESOURCE = offload()
NOW = datetime.datetime.now(datetime.UTC)


def written(folder: Path, secrets: BundleSecrets, resource: RobotOffload = RESOURCE) -> Configuration:
    """Writes a bundle to a robot's disk and reads it as the agent does."""
    files = bundle(Parent(resource, facts(endpoints=EVERY_ENDPOINT)), secrets, folder=str(folder))
    (folder / "certificates").mkdir(parents=True, exist_ok=True)
    lasting = b"/var/lib/robot-offload/wheelchair-7"
    for name, content in files.items():
        (folder / name).write_bytes(content.replace(lasting, str(folder / "state").encode()))
    return load(folder / "agent.yaml")


def secrets_of(issued: Issued) -> BundleSecrets:
    data = issued.secrets[ROLES.index("robot")]["data"]
    return BundleSecrets(*(base64.b64decode(data[key]) for key in ("ca.crt", "tls.crt", "tls.key")))


def again(before: Issued | None, request: str = "", now: datetime.datetime = NOW) -> Issued:
    live = dict(zip(ROLES, before.secrets, strict=True)) if before else {}
    return issue(Parent(RESOURCE, facts()), live, "", now, request)


def test_both_packages_sign_and_name_requests_alike() -> None:
    assert operator.PROVED == openssl.PROVED
    assert operator.digest("a request") == renewal.digest("a request")


def test_a_robot_gets_its_own_key_signed_and_dials_with_it_from_then_on(tmp_path: Path) -> None:
    issued = again(None)
    configuration = with_own_certificate(written(tmp_path, secrets_of(issued)))
    assert renews(configuration)
    wallet = Wallet(configuration)
    assert wallet.present()[1]  # the bundle's
    request = wallet.request()
    assert Wallet(configuration).request() == request  # the same after a restart
    signed = again(issued, request)
    assert signed.answer is not None
    heard = renewal.Heard(True, signed.answer.text())
    state, command = renewal.step(renewal.Renewal(request=request), heard, 0.0, 0.0)
    assert isinstance(command, renewal.Keep), state
    kept = wallet.keep(command.pem)
    assert wallet.present() == (kept, False)
    check_link(configuration)
    key = Path(configuration["link.private_key"])
    assert stat.S_IMODE(key.resolve().stat().st_mode) == 0o600
    assert key.resolve() != tmp_path / "certificates/robot.key"
    # The next start finds it, and so does one after the same bundle was written again.
    assert Wallet(with_own_certificate(written(tmp_path, secrets_of(issued)))).present() == (kept, False)
    # Years later the own key is renewed with the own key.
    later = again(signed, wallet.request(), NOW + 60 * DAY)
    assert later.answer is not None
    assert wallet.keep(later.answer.certificate).serial != kept.serial
    assert len(list((tmp_path / "state/certificates").iterdir())) == 3  # bundle, current, one own pair


def test_the_tunnel_dials_with_what_the_agent_of_a_robot_on_ddsrouter_has_renewed(tmp_path: Path) -> None:
    issued = again(None)
    wallet = Wallet(
        with_own_certificate(written(tmp_path, secrets_of(issued), offload(transport=TRANSPORTS["DDSRouter"])))
    )
    given = tunnel.read(tmp_path / "tunnel.yaml")
    assert Path(newest(given).certificate).resolve() == tmp_path / "certificates/robot.pem"
    signed = again(issued, wallet.request())
    assert signed.answer is not None
    wallet.keep(signed.answer.certificate)
    renewed = newest(given)
    assert openssl.look(Path(renewed.certificate)) == wallet.present()[0] != openssl.look(Path(given.certificate))
    context(renewed)


def test_a_newer_bundle_comes_before_an_own_certificate(tmp_path: Path) -> None:
    issued = again(None)
    wallet = Wallet(with_own_certificate(written(tmp_path, secrets_of(issued))))
    signed = again(issued, wallet.request())
    assert signed.answer is not None
    wallet.keep(signed.answer.certificate)
    revoked = again(None, now=NOW + DAY)
    fresh = Wallet(with_own_certificate(written(tmp_path, secrets_of(revoked))))
    assert fresh.present()[1]
    assert fresh.request() != ""


def test_a_certificate_for_another_key_is_not_kept(tmp_path: Path) -> None:
    wallet = Wallet(with_own_certificate(written(tmp_path, secrets_of(again(None)))))
    wallet.request()
    other = build_certificates(robot="wheelchair-7", host_names=["cloud"], now=NOW).robot.certificate.decode()
    for pem in (other, "garbage"):
        with pytest.raises(openssl.CertificateError, match="not for this robot's key"):
            wallet.keep(pem)
    assert wallet.present()[1]


def test_a_robot_without_a_place_or_without_openssl_keeps_its_bundle(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    configuration = written(tmp_path, secrets_of(again(None)))
    (tmp_path / "state").write_text("no folder")
    assert with_own_certificate(configuration) is configuration
    assert not renews(configuration)
    (tmp_path / "state").unlink()
    monkeypatch.setenv("PATH", str(tmp_path))
    assert with_own_certificate(configuration) is configuration


def test_what_a_robot_says_of_its_certificate_reaches_the_operator() -> None:
    told = Credential("1f", "2026-12-01T00:00:00Z", "a.b.c", "AlreadyRenewed", "a copy is in use")
    notes = decode_robot(encode(RobotNotes(credential=told)))
    state = liaison.step(liaison.Liaison(connected=True), liaison.RobotSaid(notes), 0.0)
    values = liaison.state(state, generation=1, epoch=1, nodes=(), ready=True)
    assert vars(told) == {name: getattr(parse_state(json.dumps(values)).certificate, name) for name in vars(told)}
    for wrong in ({"serial": 1}, {"serial": "XYZ"}, {"not_after": "soon"}, {"request": "x" * 5000}, "text", None):
        assert decode_robot(json.dumps({"credential": wrong})).credential == Credential()
