"""Network policies: all our pods are closed both ways, but for what is declared."""

from __future__ import annotations

from typing import Any

import pytest

from robot_offload.kube.port import Manifest
from robot_offload.objects.facts import Network
from tests.unit.operator.render.given import EVERY_ENDPOINT, TRANSPORTS, facts, offload, pods, rendered

DDS = ("UDP", 7400 + 250 * 42)
"""The first port of the robot's domain in the sample, which is the cloud's too where nodes of both talk directly."""


def everything(transport: str) -> dict[str, Manifest]:
    return rendered(offload(transport=TRANSPORTS[transport]), facts(endpoints=EVERY_ENDPOINT))


def policies(transport: str) -> dict[str, Manifest]:
    found = everything(transport)
    return {key.split("7-")[1]: one["spec"] for key, one in found.items() if key.startswith("NetworkPolicy/")}


def open_to_all(rules: list[Manifest], peers: str) -> set[tuple[str, int]]:
    return {(port["protocol"], port["port"]) for rule in rules if peers not in rule for port in rule["ports"]}


def open_to_pods(rules: list[Manifest], peers: str) -> set[tuple[str, int]]:
    return {(port["protocol"], port["port"]) for rule in rules if peers in rule for port in rule["ports"]}


@pytest.mark.parametrize("transport", TRANSPORTS)
def test_every_pod_is_chosen_by_exactly_one_policy_both_ways(transport: str) -> None:
    chosen = [spec["podSelector"]["matchLabels"].items() for spec in policies(transport).values()]
    for name, template in pods(everything(transport)).items():
        labels = template["metadata"]["labels"].items()
        assert sum(one <= labels for one in chosen) == 1, name
    assert all(spec["policyTypes"] == ["Ingress", "Egress"] for spec in policies(transport).values())


@pytest.mark.parametrize("transport", TRANSPORTS)
def test_no_rule_lets_everything_through(transport: str) -> None:
    for spec in policies(transport).values():
        for rule in (*spec["ingress"], *spec["egress"]):
            assert rule["ports"]
            assert rule.get("from") != []
            assert rule.get("to") != []


EXPECTED_FROM_ANYWHERE: dict[str, dict[str, set[tuple[str, int]]]] = {
    "Zenoh": {
        "agent": {("UDP", 7447), ("UDP", 7448), ("TCP", 7447), ("TCP", 7448)},
        "nodes": set(),
        "discovery": set(),
    },
    "DDSRouter": {"agent": set(), "nodes": set(), "discovery": set(), "router": {("TCP", 11666)}},
    "DiscoveryServer": {"agent": {DDS}, "nodes": {DDS}, "discovery": {("UDP", 11811), DDS}},
    "StaticPeers": {"agent": {DDS}, "nodes": {DDS}},
}


@pytest.mark.parametrize("transport", TRANSPORTS)
def test_from_outside_comes_only_what_the_robot_needs(transport: str) -> None:
    found = {name: open_to_all(spec["ingress"], "from") for name, spec in policies(transport).items()}
    assert found == EXPECTED_FROM_ANYWHERE[transport]


def test_only_nodes_may_ask_for_a_handover() -> None:
    [rule] = [one for one in policies("Zenoh")["agent"]["ingress"] if one["ports"][0]["port"] == 8080]
    [peer] = rule["from"]
    assert peer["podSelector"]["matchLabels"]["app.kubernetes.io/component"] == "node"
    assert ("TCP", 8080) in open_to_pods(policies("Zenoh")["nodes"]["egress"], "to")


def test_only_the_agents_pod_reaches_the_api_server() -> None:
    for transport in TRANSPORTS:
        found = {
            name for name, spec in policies(transport).items() if ("TCP", 6443) in open_to_all(spec["egress"], "to")
        }
        assert found == {"agent"}


def test_dds_passes_between_the_pods_of_one_robot_and_no_others() -> None:
    for name, spec in policies("Zenoh").items():
        for rules, peers in ((spec["ingress"], "from"), (spec["egress"], "to")):
            [rule] = [one for one in rules if one["ports"][0].get("endPort")]
            assert rule[peers] == [
                {
                    "podSelector": {
                        "matchLabels": {
                            "app.kubernetes.io/name": "robot-offload",
                            "app.kubernetes.io/instance": "wheelchair-7",
                        }
                    }
                }
            ], name
            assert (rule["ports"][0]["port"], rule["ports"][0]["endPort"]) == (18150, 18399)


@pytest.mark.parametrize(("domain", "last"), [(0, 7649), (232, 65535)])
def test_the_ports_of_a_domain_end_where_ports_end(domain: int, last: int) -> None:
    changes: dict[str, Any] = {"cloud.domainID": domain}
    spec = rendered(offload(changes))["NetworkPolicy/wheelchair-7-nodes"]["spec"]
    assert spec["ingress"][0]["ports"][0]["endPort"] == last


def test_an_administrator_says_where_name_servers_api_servers_and_prometheus_are() -> None:
    network = Network(dns=("10.96.0.10/32",), api_server=("192.0.2.1/32",), metrics_from=("monitoring",))
    agent = rendered(offload(), facts(network=network))["NetworkPolicy/wheelchair-7-agent"]["spec"]
    blocks = {each["ipBlock"]["cidr"] for rule in agent["egress"] for each in rule.get("to", ()) if "ipBlock" in each}
    assert blocks == {"10.96.0.10/32", "192.0.2.1/32"}
    assert not [rule for rule in agent["egress"] if "to" not in rule]  # nothing goes just anywhere
    readers = [rule for rule in agent["ingress"] for each in rule.get("from", ()) if "namespaceSelector" in each]
    assert readers == [
        {
            "from": [{"namespaceSelector": {"matchLabels": {"kubernetes.io/metadata.name": "monitoring"}}}],
            "ports": [{"protocol": "TCP", "port": 8080}],
        }
    ]


def test_api_servers_on_other_hosts_are_let_in_to_the_reporter_alone_and_only_when_asked_for() -> None:
    network = Network(api_server_from=("192.0.2.0/28", "fd00::/64"))
    before, after = (rendered(offload(), facts(network=one)) for one in (Network(), network))
    policies = [name for name in before if name.startswith("NetworkPolicy/")]
    assert [name for name in policies if before[name] != after[name]] == ["NetworkPolicy/wheelchair-7-agent"]
    plain, opened = (made["NetworkPolicy/wheelchair-7-agent"]["spec"]["ingress"] for made in (before, after))
    assert [rule for rule in opened if rule not in plain] == [
        {
            "from": [{"ipBlock": {"cidr": "192.0.2.0/28"}}, {"ipBlock": {"cidr": "fd00::/64"}}],
            "ports": [{"protocol": "TCP", "port": 8080}],
        }
    ]


def test_an_administrator_may_want_no_policies_of_ours() -> None:
    children = rendered(offload(), facts(network=Network(policies=False)))
    assert not [name for name in children if name.startswith("NetworkPolicy/")]
