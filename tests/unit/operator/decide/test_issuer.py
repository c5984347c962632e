"""Certificates from the user's own issuer."""

from __future__ import annotations

import dataclasses
import re
from typing import Any, Final

from robot_offload.decide.issuer import certificates, verdict
from robot_offload.objects.parent import Parent
from robot_offload.render.agent_config import agent_parameters
from robot_offload.render.agent_workload import site
from tests.unit.operator.decide.worlds import FACTS, offload

SIDES: Final = ("robot", "cloud")
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
    assert robot["spec"]["commonName"] == "walker_fleet"
    assert cloud["spec"]["commonName"] == "cloud_walker_fleet"
    assert "client auth" in robot["spec"]["usages"]
    assert "server auth" not in robot["spec"]["usages"]
    assert robot["spec"]["issuerRef"] == {"name": "fleet", "kind": "ClusterIssuer", "group": "cert-manager.io"}
    assert (robot["spec"]["duration"], robot["spec"]["renewBefore"]) == ("172800s", "43200s")


def test_robots_of_one_name_in_two_namespaces_never_pass_for_each_other() -> None:
    here = Parent(offload(transport=TRANSPORT), FACTS)
    there = Parent(offload(transport=TRANSPORT), dataclasses.replace(FACTS, namespace="other"))
    far = Parent(offload(transport=TRANSPORT), dataclasses.replace(FACTS, namespace="n" * 63))
    names = [parent.certificate_name(side) for parent in (here, there, far) for side in SIDES]
    assert len(set(names)) == 6
    assert all(len(name) <= 64 and re.fullmatch(r"[A-Za-z0-9._-]+", name) for name in names)
    for parent in (here, there, far):
        assert agent_parameters(parent.offload, site(parent))["link"]["peer_name"] == parent.certificate_name("robot")


def test_they_are_ready_when_the_issuer_has_written_all_three_parts_of_both() -> None:
    full: dict[str, Any] = {"data": {"tls.crt": "a", "tls.key": "b", "ca.crt": "c"}}
    assert verdict({"cloud": full, "robot": full}).holds
    waiting = verdict({"cloud": full, "robot": {"data": {"tls.crt": "a", "tls.key": "b"}}})
    assert waiting.reason == "WaitingForIssuer"
    assert "ca.crt of the robot's certificate" in waiting.message
    assert not verdict({}).holds
