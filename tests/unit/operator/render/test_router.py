"""The DDS Router: two phases, exactly the declared topics, and a check of our own because it ignores unknown keys."""

from __future__ import annotations

import copy
from typing import Any

import pytest
import yaml

from robot_offload.errors import RobotOffloadError
from robot_offload.objects.facts import Endpoint
from robot_offload.objects.parent import Parent
from robot_offload.render.bundle import BundleSecrets, bundle
from robot_offload.transport import dds_router_config as router
from tests.unit.operator.render.given import ROUTER, facts, offload, rendered

NAME = "wheelchair-7-router"
SECRETS = BundleSecrets(b"ca", b"certificate", b"key")


def config(endpoint: Endpoint = ROUTER, **block: Any) -> dict[str, Any]:
    resource = offload(transport={"type": "DDSRouter", **block})
    text = rendered(resource, facts(endpoints=(endpoint,)))[f"ConfigMap/{NAME}"]["data"]["router.yaml"]
    found: dict[str, Any] = yaml.safe_load(text)
    return found


def wan(document: dict[str, Any]) -> dict[str, Any]:
    [found] = [one for one in document["participants"] if one["kind"] == "wan"]
    assert isinstance(found, dict)
    return found


def on_the_robot(endpoint: Endpoint = ROUTER, **block: Any) -> dict[str, Any]:
    resource = offload(transport={"type": "DDSRouter", **block})
    files = bundle(Parent(resource, facts(endpoints=(endpoint,))), SECRETS)
    found: dict[str, Any] = yaml.safe_load(files["ddsrouter.yaml"])
    return found


def test_first_there_is_a_service_only() -> None:
    keys = rendered(offload(transport={"type": "DDSRouter"})).keys()
    assert [key for key in keys if key.endswith(NAME)] == [f"NetworkPolicy/{NAME}", f"Service/{NAME}"]


def test_with_its_address_there_are_a_configuration_and_a_pod_that_announces_it() -> None:
    keys = rendered(offload(transport={"type": "DDSRouter"}), facts(endpoints=(ROUTER,))).keys()
    assert {f"ConfigMap/{NAME}", f"Deployment/{NAME}"} <= keys
    assert wan(config())["listening-addresses"] == [
        {"ip": "203.0.113.7", "port": 11666, "transport": "tcp", "external-port": 11666}
    ]


def test_a_name_is_announced_as_a_name_and_another_port_as_the_outside_one() -> None:
    [address] = wan(config(Endpoint("router", "TCP", "lb.example.com", 30666)))["listening-addresses"]
    assert address == {"domain": "lb.example.com", "port": 11666, "transport": "tcp", "external-port": 30666}


def test_an_ipv6_address_is_said_to_be_one() -> None:
    [address] = wan(config(Endpoint("router", "TCP", "2001:db8::1", 11666)))["listening-addresses"]
    assert (address["ip"], address["ip-version"]) == ("2001:db8::1", "v6")


def test_both_sides_speak_version_5_and_allow_the_same_topics() -> None:
    cloud, robot = config(), on_the_robot()
    assert cloud["version"] == robot["version"] == "v5.0"
    assert cloud["allowlist"] == robot["allowlist"]


def test_exactly_the_declared_topics_and_the_agents_own_cross() -> None:
    assert [one["name"] for one in config()["allowlist"]] == [
        "rt/connectivity_test_local",
        "rt/offload/link/robot/probe",
        "rt/offload/link/robot/out_cmd_vel",
        "rt/connectivity_test_remote",
        "rt/offload/link/cloud/probe",
        "rt/offload/link/cloud/out_cmd_vel",
        "rt/scan",
        "rt/odom",
        "rt/goal_pose",
    ]


def test_the_cloud_joins_its_discovery_servers_and_the_robot_its_own_domain() -> None:
    [cluster] = [one for one in config()["participants"] if one["kind"] != "wan"]
    assert (cluster["kind"], cluster["domain"]) == ("local-discovery-server", 43)
    assert [one["ip"] for one in cluster["connection-addresses"]] == ["10.96.0.8", "10.96.0.9"]
    [local] = [one for one in on_the_robot()["participants"] if one["kind"] != "wan"]
    assert (local["kind"], local["domain"]) == ("local", 42)
    [other] = [one for one in on_the_robot(ddsRouter={"domainID": 9})["participants"] if one["kind"] != "wan"]
    assert other["domain"] == 9


def test_the_connection_is_encrypted_and_the_robot_checks_who_answers() -> None:
    assert wan(config())["tls"].keys() == {"private_key", "cert", "dh_params"}
    assert wan(on_the_robot())["tls"] == {"ca": "/etc/robot-offload/wheelchair-7/certificates/ca.pem"}
    named = wan(on_the_robot(expose={"host": "edge.example"}))
    assert named["tls"]["sni_host"] == "edge.example"


GOOD = router.config(
    [
        {"name": "Robot", "kind": "local", "domain": 3},
        {
            "name": "Wan",
            "kind": "wan",
            "connection-addresses": [router.address("203.0.113.7", 11666, "tcp")],
            "tls": {"ca": "ca.pem"},
        },
    ],
    ["/scan"],
)


def broken(path: str, value: Any) -> tuple[str, ...]:
    document = copy.deepcopy(GOOD)
    target: Any = document
    *parents, last = path.split(".")
    for part in parents:
        target = target[int(part)] if part.isdigit() else target[part]
    target[int(last) if last.isdigit() else last] = value
    return router.problems(document)


@pytest.mark.parametrize(
    ("path", "value", "told"),
    [
        ("allow-list", [], "the router does not know this key"),
        ("specs.max-depth", 5, "specs.max-depth: the router does not know"),
        ("version", "v3.0", "version: must be v5.0"),
        ("allowlist", [], "an empty one lets every topic through"),
        ("allowlist.0.name", "rt/*", "wildcard"),
        ("allowlist.0.name", "/scan", "rt/, rq/, rr/"),
        ("participants.0.kind", "simpel", "participants[0].kind: 'simpel' is none of"),
        ("participants.0.domain", 300, "not within 0 .. 232"),
        ("participants.1.name", "Robot", "each name once"),
        ("participants.1.connection-addresses", [], "needs an address"),
        ("participants.1.connection-addresses.0.transport", "quic", "must be tcp or udp"),
        ("participants.1.connection-addresses.0.ip", "0.0.0.0", "nobody can connect"),
        ("participants.1.connection-addresses.0.domain", "a.b", "either ip or domain"),
        ("participants.1.connection-addresses.0.port", 0, "is not a port"),
        ("participants.1.tls.ca", "", "tls.ca: is needed"),
        ("participants.1.tls.cert", "x", "tls.cert: the router does not know"),
        ("participants.1.discovery-server-guid", {}, "discovery-server-guid: the router does not know"),
    ],
)
def test_what_the_router_would_refuse_or_misread_is_told(path: str, value: Any, told: str) -> None:
    assert any(told in line for line in broken(path, value)), broken(path, value)


def test_udp_cannot_change_its_port_on_the_way() -> None:
    address = {"ip": "203.0.113.7", "port": 1, "external-port": 2, "transport": "udp"}
    assert any("must be the port itself" in line for line in broken("participants.1.connection-addresses.0", address))


def test_only_one_address_to_listen_on_is_opened() -> None:
    entries = [router.address("203.0.113.7", 1, "tcp"), router.address("203.0.113.8", 2, "tcp")]
    one = {"name": "Wan", "kind": "wan", "listening-addresses": entries}
    assert any("only the first TCP port" in line for line in broken("participants.1", one))


def test_a_bad_configuration_is_never_rendered() -> None:
    with pytest.raises(RobotOffloadError, match="nobody can connect"):
        config(Endpoint("router", "TCP", "0.0.0.0", 11666))
