"""The tunnel's file: what the operator package renders is exactly what the agent package reads."""

from __future__ import annotations

import yaml

from robot_offload.objects.facts import Endpoint
from robot_offload.objects.parent import Parent
from robot_offload.render.bundle import BundleSecrets, bundle
from robot_offload_agent.tunnel.configuration import TunnelConfiguration, parse
from robot_offload_core.fence.token import Site
from tests.unit.operator.render.given import facts, offload, rendered

RESOURCE = offload(transport={"type": "DDSRouter", "expose": {"host": "edge.example"}})
ENDPOINTS = (Endpoint("router", "TCP", "edge.example", 11666), Endpoint("router", "TCP", "2001:db8::1", 30666))


def cloud() -> TunnelConfiguration:
    return parse(yaml.safe_load(rendered(RESOURCE)["ConfigMap/wheelchair-7-router"]["data"]["tunnel.yaml"]))


def robot() -> TunnelConfiguration:
    files = bundle(Parent(RESOURCE, facts(endpoints=ENDPOINTS)), BundleSecrets(b"ca", b"certificate", b"key"))
    return parse(yaml.safe_load(files["tunnel.yaml"]))


def test_both_files_are_read_as_they_are_meant() -> None:
    assert (cloud().side, robot().side) == (Site.CLOUD, Site.ROBOT)
    assert [(one.host, one.port) for one in robot().connect] == [("edge.example", 11666), ("2001:db8::1", 30666)]
    assert robot().verify_name
    assert robot().realtime


def test_the_robots_tunnel_waits_where_the_routers_meet_and_the_clouds_goes_where_its_router_listens() -> None:
    assert str(robot().listen) == "127.0.0.1:11667"
    assert [str(one) for one in cloud().connect] == ["127.0.0.1:11668"]
    assert cloud().peer_name == RESOURCE.metadata.name
