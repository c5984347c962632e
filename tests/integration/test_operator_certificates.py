"""A robot's certificates under a running operator: its own key is signed once, and everybody sees which one it uses."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

import pytest

from robot_offload.decide.authorities import AUTHORITIES
from robot_offload.decide.certificates import LEAVES
from robot_offload.decide.ownership import APPLIED
from robot_offload.kube.kinds import CONFIG_MAP, ROBOT_OFFLOAD, SECRET
from robot_offload.objects.labels import INSTANCE, MANAGED_BY, MANAGER
from robot_offload_agent.certificates.openssl import look, make_key
from robot_offload_agent.certificates.wallet import CERTIFICATE, CURRENT, KEY, Wallet
from robot_offload_agent.settings.parameters import Configuration
from tests.integration.operator_cluster import HOME, Manifest, Place, eventually, walker
from tests.integration.operator_process import Operator
from tests.integration.operator_proxy import Proxy

pytestmark = pytest.mark.api
STATIC_PEERS = {"type": "StaticPeers", "staticPeers": {"robot": ["10.0.0.1"], "cloud": ["10.0.0.2"]}}
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
    eventually(lambda: "AlreadyRenewed" in {event["reason"] for event in place.events()}, "the event", place.events)
    assert place.condition("CertificatesReady")["status"] == "True"  # the cloud can serve
    assert (tmp_path / "robot/certificates" / CURRENT).resolve().name == kept.serial


def test_a_late_write_of_a_leader_that_was_never_puts_another_authority_in_place(place: Place, proxy: Proxy) -> None:
    at_home = len(proxy.writes_in(HOME))
    place.create(ROBOT_OFFLOAD, walker())
    place.applied()
    asked = [*proxy.writes_in(place.namespace), *proxy.writes_in(HOME)[at_home:]]
    writes = [one for one in asked if "/secrets" in one.path]
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


def data_of(place: Place) -> dict[str, Any]:
    """What is in all Secrets of the walker, by role."""
    leaves = {role: place.there(SECRET, f"walker-{role}")["data"] for role in LEAVES}
    return {**leaves, **{role: secret["data"] for role, secret in place.authorities().items()}}


def as_before(place: Place, role: str, data: Manifest) -> None:
    """Puts an authority's Secret where earlier versions of the operator kept it."""
    uid = place.roff()["metadata"]["uid"]
    owner = {
        "apiVersion": ROBOT_OFFLOAD.api_version, "kind": ROBOT_OFFLOAD.kind, "name": "walker", "uid": uid,
        "controller": True,
    }  # fmt: skip
    metadata = {
        "name": f"walker-{role}",
        "labels": {INSTANCE: "walker", MANAGED_BY: MANAGER},
        "annotations": {APPLIED: f"{uid}/0"},
        "ownerReferences": [owner],
    }
    place.create(SECRET, {"metadata": metadata, "type": "kubernetes.io/tls", "data": data})


def test_no_key_that_signs_others_is_beside_the_robots_and_it_survives_other_transports(place: Place) -> None:
    place.create(ROBOT_OFFLOAD, walker())
    place.applied()
    before = data_of(place)
    assert set(before) == {"server-ca", "client-ca", "cloud", "robot"}
    place.replace_spec(walker(transport=STATIC_PEERS)["spec"])
    place.applied()
    assert {secret["metadata"]["name"] for secret in place.list(SECRET)} == {"walker-cloud", "walker-robot"}
    place.replace_spec(walker()["spec"])
    place.applied()
    assert data_of(place) == before
    home = Place(place.plane, HOME)
    home.delete(SECRET, place.authorities()["client-ca"]["metadata"]["name"])  # by hand
    eventually(lambda: place.authorities().keys() == set(AUTHORITIES), "a new authority")
    eventually(lambda: data_of(place)["robot"] != before["robot"], "a certificate of it")


def test_keys_of_earlier_versions_move_to_the_operators_namespace_and_planted_ones_do_not(
    place: Place, operator: Operator
) -> None:
    place.create(ROBOT_OFFLOAD, walker())
    place.applied()
    before = data_of(place)
    operator.stop()
    home = Place(place.plane, HOME)
    for role, secret in place.authorities().items():
        home.delete(SECRET, secret["metadata"]["name"])
        as_before(place, role, secret["data"])
    operator.restart()
    former = {f"walker-{role}" for role in AUTHORITIES}
    eventually(lambda: not former & {one["metadata"]["name"] for one in place.list(SECRET)}, "the former ones to go")
    assert data_of(place) == before  # all bundles stay good
    # Beside a RobotOffload that no operator has seen, such a Secret is somebody else's.
    operator.stop()
    place.delete(ROBOT_OFFLOAD, "walker")
    place.gone(ROBOT_OFFLOAD, "walker")
    place.create(ROBOT_OFFLOAD, walker())
    as_before(place, "client-ca", before["client-ca"])
    operator.restart()
    place.applied()
    assert data_of(place)["client-ca"] != before["client-ca"]


def test_keys_go_with_their_robotoffload_and_with_no_other(place: Place, operator: Operator) -> None:
    for name in ("walker", "runner"):
        place.create(ROBOT_OFFLOAD, walker(name))
        place.applied(name)
    walkers, runners = (place.roff(name)["metadata"]["uid"] for name in ("walker", "runner"))
    place.delete(ROBOT_OFFLOAD, "walker")
    eventually(lambda: not place.authorities(walkers), "the keys to be collected")
    assert place.authorities(runners).keys() == set(AUTHORITIES)
    operator.stop()
    place.delete(ROBOT_OFFLOAD, "runner")
    place.gone(ROBOT_OFFLOAD, "runner")
    operator.restart()
    eventually(lambda: not place.authorities(runners), "the keys of what went while no operator ran")
