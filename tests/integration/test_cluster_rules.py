"""What the test cluster decides without touching anything: policies as rules, load balancer addresses, recordings."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest

from robot_offload_lab.cluster import load_balancer, policies, programs
from robot_offload_lab.cluster.by_hand import link
from robot_offload_lab.cluster.errors import ClusterError
from robot_offload_lab.cluster.layout import NUMBERS, Layout
from robot_offload_lab.cluster.preflight import preflight
from tests.integration.cluster_objects import echo_service, policy

LAYOUT = Layout(0)


def pod(name: str, address: str, node: str = "node1", namespace: str = "ours", **labels: str) -> dict[str, Any]:
    ports = [{"name": "web", "containerPort": 80}]
    return {
        "metadata": {"name": name, "namespace": namespace, "labels": labels},
        "spec": {"nodeName": node, "containers": [{"ports": ports}]},
        "status": {"phase": "Running", "podIP": address},
    }


PODS = [
    pod("server", "10.0.0.1", app="server"),
    pod("friend", "10.0.0.2", app="friend"),
    pod("elsewhere", "10.0.1.3", node="node2", namespace="theirs", app="friend"),
]
NAMESPACES = [{"metadata": {"name": name, "labels": {"team": name}}} for name in ("ours", "theirs")]


def rules(**spec: Any) -> list[str]:
    """The lines of node1's rules with one policy for the server."""
    one = policy("one", "server", **spec)
    one["metadata"]["namespace"] = "ours"
    return [line.strip() for line in policies.ruleset("node1", [one], PODS, NAMESPACES).splitlines()]


def chain(lines: list[str], name: str) -> list[str]:
    """The rules of one chain."""
    begin = lines.index(f"chain {name} {{")
    return lines[begin + 1 : lines.index("}", begin)]


def test_without_a_policy_nothing_is_closed() -> None:
    assert "drop" not in policies.ruleset("node1", [], PODS, NAMESPACES)


def test_a_policy_without_rules_closes_the_pods_that_it_selects_and_no_others() -> None:
    lines = rules()
    assert chain(lines, "in_10_0_0_1") == ["drop"]
    assert "ip daddr vmap { 10.0.0.1 : jump in_10_0_0_1 }" in lines
    assert not any("saddr vmap" in line for line in lines)


def test_a_policy_is_enforced_where_the_pod_is() -> None:
    one = policy("one", "server")
    one["metadata"]["namespace"] = "ours"
    assert "drop" not in policies.ruleset("node2", [one], PODS, NAMESPACES)


@pytest.mark.parametrize(
    ("peer", "allowed"),
    [
        ({"podSelector": {}}, "ip saddr { 10.0.0.1, 10.0.0.2 } return"),
        ({"podSelector": {"matchLabels": {"app": "friend"}}}, "ip saddr { 10.0.0.2 } return"),
        ({"namespaceSelector": {"matchLabels": {"team": "theirs"}}}, "ip saddr { 10.0.1.3 } return"),
        (
            {"namespaceSelector": {}, "podSelector": {"matchLabels": {"app": "friend"}}},
            "ip saddr { 10.0.0.2, 10.0.1.3 } return",
        ),
        ({"ipBlock": {"cidr": "10.0.0.0/8"}}, "ip saddr 10.0.0.0/8 return"),
        (
            {"ipBlock": {"cidr": "10.0.0.0/8", "except": ["10.1.0.0/16"]}},
            "ip saddr 10.0.0.0/8 ip saddr != { 10.1.0.0/16 } return",
        ),
    ],
)
def test_a_peer_is_allowed_by_what_selects_it(peer: dict[str, Any], allowed: str) -> None:
    assert chain(rules(ingress=[{"from": [peer]}]), "in_10_0_0_1") == [allowed, "drop"]


def test_a_peer_that_nobody_is_allows_nothing() -> None:
    nobody = {"podSelector": {"matchLabels": {"app": "nobody"}}}
    assert chain(rules(ingress=[{"from": [nobody]}]), "in_10_0_0_1") == ["drop"]


@pytest.mark.parametrize(
    ("port", "allowed"),
    [
        ({"port": 80}, "tcp dport 80 return"),
        ({"port": 7400, "endPort": 7649, "protocol": "UDP"}, "udp dport 7400-7649 return"),
        ({"protocol": "UDP"}, "meta l4proto udp return"),
        ({"port": "web"}, "tcp dport 80 return"),
    ],
)
def test_a_port_is_allowed_by_number_range_or_name(port: dict[str, Any], allowed: str) -> None:
    assert chain(rules(ingress=[{"ports": [port]}]), "in_10_0_0_1") == [allowed, "drop"]


def test_egress_closes_the_other_way_only_if_it_is_named() -> None:
    to_friends = {"to": [{"podSelector": {"matchLabels": {"app": "friend"}}}]}
    lines = rules(policyTypes=["Egress"], egress=[to_friends])
    assert chain(lines, "out_10_0_0_1") == ["ip daddr { 10.0.0.2 } return", "drop"]
    assert not any("daddr vmap" in line for line in lines)


@pytest.mark.parametrize(
    ("operator", "values", "chosen"),
    [
        ("In", ["friend"], True),
        ("In", ["server"], False),
        ("NotIn", ["server"], True),
        ("Exists", None, True),
        ("DoesNotExist", None, False),
    ],
)
def test_labels_are_selected_by_expression(operator: str, values: list[str] | None, chosen: bool) -> None:
    expression = {"key": "app", "operator": operator, "values": values}
    assert policies.selects({"matchExpressions": [expression]}, {"app": "friend"}) is chosen


def service(name: str, address: str = "", **spec: str) -> dict[str, Any]:
    made = echo_service(name, type="LoadBalancer", **spec)
    made["metadata"] |= {"namespace": "ours", "creationTimestamp": name}
    return {**made, "status": {"loadBalancer": {"ingress": [{"ip": address}]} if address else {}}}


def node(name: str, address: str, ready: str = "True") -> dict[str, Any]:
    conditions = [{"type": "Ready", "status": ready}]
    return {
        "metadata": {"name": name},
        "status": {"conditions": conditions, "addresses": [{"type": "InternalIP", "address": address}]},
    }


def test_each_service_gets_an_address_that_no_other_has() -> None:
    given = load_balancer.missing_addresses([service("a", "10.120.1.10"), service("b"), service("c")], LAYOUT)
    assert [(each["metadata"]["name"], address) for each, address in given] == [
        ("b", "10.120.1.11"),
        ("c", "10.120.1.12"),
    ]


def test_a_service_gets_the_address_that_it_wishes() -> None:
    given = load_balancer.missing_addresses([service("a", loadBalancerIP="10.120.1.99")], LAYOUT)
    assert [address for _, address in given] == ["10.120.1.99"]


def test_other_services_get_none() -> None:
    assert load_balancer.missing_addresses([{**echo_service(), "status": {}}], LAYOUT) == []


def test_an_address_leads_to_a_node_that_works_and_stays_there() -> None:
    nodes = [node("node1", "one", ready="Unknown"), node("node2", "two"), node("node3", "three")]
    services = [service("a", "10.120.1.10")]
    assert load_balancer.routes(services, [], nodes, {}, LAYOUT) == {"10.120.1.10": "two"}
    assert load_balancer.routes(services, [], nodes, {"10.120.1.10": "three"}, LAYOUT) == {"10.120.1.10": "three"}
    assert load_balancer.routes(services, [], nodes, {"10.120.1.10": "one"}, LAYOUT) == {"10.120.1.10": "two"}


def test_an_address_with_the_local_policy_leads_to_a_node_with_a_pod() -> None:
    nodes = [node("node1", "one"), node("node2", "two")]
    services = [service("a", "10.120.1.10", externalTrafficPolicy="Local")]
    labels = {"kubernetes.io/service-name": "a"}
    endpoints = [{"nodeName": "node2", "conditions": {"ready": True}}]
    slices = [{"metadata": {"namespace": "ours", "labels": labels}, "endpoints": endpoints}]
    assert load_balancer.routes(services, slices, nodes, {}, LAYOUT) == {"10.120.1.10": "two"}
    assert load_balancer.routes(services, [], nodes, {}, LAYOUT) == {}


def test_clusters_side_by_side_share_no_address() -> None:
    assert len({Layout(number).everything for number in NUMBERS}) == len(NUMBERS)
    with pytest.raises(ClusterError, match="0 to 9"):
        Layout(10)


def test_settings_of_a_wire_are_read_from_words() -> None:
    assert link(["delay_ms=10", "loss_pct=0.5", "cut=both"]) == {"delay_ms": 10.0, "loss_pct": 0.5, "cut": "both"}
    assert link(["cut="]) == {"cut": None}
    for wrong in ("delay=10", "delay_ms=much", "cut=half"):
        with pytest.raises(ClusterError, match="is not a setting of a wire"):
            link([wrong])


def test_who_is_not_root_is_told_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    assert "one must be root. Next: run it with sudo" in str(preflight())


def test_missing_packages_are_named_with_the_command_that_installs_them(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    monkeypatch.setenv("PATH", str(tmp_path))
    why = str(preflight())
    assert "These packages are missing: conntrack, containerd," in why
    assert "Next: apt-get install conntrack containerd" in why


def test_a_changed_program_of_the_pods_is_built_anew(tmp_path: Path) -> None:
    for name in ("go.mod", "go.sum", "main.go"):
        (tmp_path / name).write_text(name)
    before = programs._key("go1.26.0", tmp_path)
    assert programs._key("go1.26.0", tmp_path) == before
    (tmp_path / "main.go").write_text("changed")
    assert programs._key("go1.26.0", tmp_path) != before
