"""Certificates from the user's own issuer."""

from __future__ import annotations

from typing import Any

from robot_offload.decide.issuer import certificates, verdict
from robot_offload.objects.parent import Parent
from tests.unit.operator.decide.worlds import FACTS, offload

TRANSPORT = {
    "type": "Zenoh",
    "expose": {"host": "edge.example.org"},
    "certificates": {"issuerRef": {"name": "fleet", "kind": "ClusterIssuer"}, "duration": "48h", "renewBefore": "12h"},
}


def test_two_certificates_are_asked_for_one_for_each_side() -> None:
    cloud, robot = certificates(Parent(offload(transport=TRANSPORT), FACTS))
    assert cloud["spec"]["secretName"] == "walker-cloud"
    assert cloud["spec"]["dnsNames"] == ["edge.example.org", "walker-udp.fleet.svc"]
    assert "server auth" in cloud["spec"]["usages"]
    assert "client auth" not in cloud["spec"]["usages"]
    assert robot["spec"]["commonName"] == "walker"
    assert "client auth" in robot["spec"]["usages"]
    assert "server auth" not in robot["spec"]["usages"]
    assert robot["spec"]["issuerRef"] == {"name": "fleet", "kind": "ClusterIssuer", "group": "cert-manager.io"}
    assert (robot["spec"]["duration"], robot["spec"]["renewBefore"]) == ("172800s", "43200s")


def test_they_are_ready_when_the_issuer_has_written_all_three_parts_of_both() -> None:
    full: dict[str, Any] = {"data": {"tls.crt": "a", "tls.key": "b", "ca.crt": "c"}}
    assert verdict({"cloud": full, "robot": full}).holds
    waiting = verdict({"cloud": full, "robot": {"data": {"tls.crt": "a", "tls.key": "b"}}})
    assert waiting.reason == "WaitingForIssuer"
    assert "ca.crt of the robot's certificate" in waiting.message
    assert not verdict({}).holds
