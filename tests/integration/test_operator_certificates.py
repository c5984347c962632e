"""A robot's certificates under a running operator: its own key is signed once, and everybody sees which one it uses."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

import pytest

from robot_offload.kube.kinds import CONFIG_MAP, ROBOT_OFFLOAD, SECRET
from robot_offload_agent.certificates.openssl import look, make_key
from robot_offload_agent.certificates.wallet import CERTIFICATE, CURRENT, KEY, Wallet
from robot_offload_agent.settings.parameters import Configuration
from tests.integration.operator_cluster import Place, eventually, walker
from tests.integration.operator_process import Operator
from tests.integration.operator_proxy import Proxy

pytestmark = pytest.mark.api
FAR = "2099-01-01T00:00:00Z"


def bundled(place: Place, folder: Path) -> tuple[Path, Path]:
    """Writes what a bundle of now holds: certificate and key."""
    folder.mkdir(exist_ok=True)
    data = place.there(SECRET, "walker-robot")["data"]
    files = folder / CERTIFICATE, folder / KEY
    for file, entry in zip(files, ("tls.crt", "tls.key"), strict=True):
        file.write_bytes(base64.b64decode(data[entry]))
    return files


def wallet_of(folder: Path) -> Wallet:
    return Wallet(Configuration({"state_dir": str(folder), "robot_name": "walker", "uid": "u"}, (), (), ()))


def answer(place: Place) -> dict[str, Any]:
    """What the operator has to say to the robot; empty: nothing."""
    found = place.there(CONFIG_MAP, "walker-settings")["data"].get("certificate.json")
    return dict(json.loads(found)) if found else {}


def asked(wallet: Wallet) -> dict[str, str]:
    return {"serial": wallet.present()[0].serial, "not_after": FAR, "request": wallet.request()}


def test_a_robots_own_key_is_signed_once_and_a_copy_of_its_bundle_gets_nothing(
    place: Place, operator: Operator, proxy: Proxy, tmp_path: Path
) -> None:
    place.create(ROBOT_OFFLOAD, walker())
    place.applied()
    files = bundled(place, tmp_path / "bundle")
    wallet = wallet_of(tmp_path / "robot")
    wallet.choose(*files)
    place.renew("cloud", "LinkGood", certificate=asked(wallet))
    signed = eventually(lambda: answer(place), "the answer to the robot")
    operator.restart()  # the answer is the same after it
    place.renew("robot", "LinkBad", certificate=asked(wallet))
    eventually(lambda: place.roff()["status"]["placementReason"] == "LinkBad", "a pass of the new operator")
    assert answer(place) == signed
    kept = wallet.keep(signed["certificate"])
    place.renew("cloud", "LinkGood", certificate={"serial": kept.serial, "not_after": FAR})
    eventually(lambda: not answer(place), "the answer to go with the request")
    wanted = {"serial": kept.serial, "notAfter": FAR}
    eventually(lambda: place.roff()["status"]["certificates"].get("robot") == wanted, "what the robot says")
    shown = place.roff()["status"]["certificates"]
    assert place.wait_condition("CertificateCurrent", "True")["reason"] == "Current"
    # The next bundle holds another certificate than the one that was used.
    assert shown["bundle"]["serial"] == look(bundled(place, tmp_path / "next")[0]).serial
    assert shown["bundle"]["serial"] != look(files[0]).serial
    proxy.quiet(place.namespace)
    _, told = operator.ask("metrics", "/metrics")
    series = f'expiration_timestamp_seconds{{holder="robot",name="walker",namespace="{place.namespace}"}}'
    assert series in told
    # Whoever copied the bundle before asks for a key as well.
    thief = wallet_of(tmp_path / "thief")
    thief.choose(*files)
    place.renew("cloud", "LinkGood", certificate=asked(thief))
    found = place.wait_condition("CertificateCurrent", "False")
    assert found["reason"] == "AlreadyRenewed"
    assert answer(place)["certificate"] == ""
    assert "AlreadyRenewed" in {event["reason"] for event in place.events()}
    assert place.condition("CertificatesReady")["status"] == "True"  # the cloud can serve
    assert (tmp_path / "robot/certificates" / CURRENT).resolve().name == kept.serial


def test_a_late_write_of_a_leader_that_was_never_puts_another_authority_in_place(place: Place, proxy: Proxy) -> None:
    place.create(ROBOT_OFFLOAD, walker())
    place.applied()
    writes = [asked for asked in proxy.writes_in(place.namespace) if "/secrets" in asked.path]
    assert len(writes) == 4
    assert {asked.method for asked in writes} == {"POST"}  # which the API server refuses where there is one already


def test_who_may_write_the_robots_lease_and_nothing_else_gets_no_certificate(place: Place, tmp_path: Path) -> None:
    place.create(ROBOT_OFFLOAD, walker())
    place.applied()
    certificate, _ = bundled(place, tmp_path / "bundle")
    other = tmp_path / "other.key"
    wallet = wallet_of(tmp_path / "stranger")
    wallet.choose(certificate, other)  # it knows the certificate, which is public, and not the key
    make_key(other)
    place.renew("cloud", "LinkGood", certificate=asked(wallet))
    assert place.wait_condition("CertificateCurrent", "False")["reason"] == "NoProof"
    assert "renewed.crt" not in place.there(SECRET, "walker-robot")["data"]


def test_the_end_of_a_robots_certificate_is_told_in_time_also_while_it_is_away(place: Place) -> None:
    place.create(ROBOT_OFFLOAD, walker(transport={"certificates": {"duration": "2160h", "renewBefore": "720h"}}))
    place.applied()
    assert place.condition("CertificateCurrent")["reason"] == "NotReported"
    place.renew("cloud", "LinkGood", certificate={"serial": "1f", "not_after": "2026-01-01T00:00:00Z"})
    assert place.wait_condition("CertificateCurrent", "False")["reason"] == "Expired"
    place.renew("robot", "LinkBad")  # nothing is said of it any more
    eventually(lambda: place.roff()["status"]["placementReason"] == "LinkBad", "a further pass")
    assert place.condition("CertificateCurrent")["reason"] == "Expired"
    assert place.roff()["status"]["certificates"]["robot"]["serial"] == "1f"
