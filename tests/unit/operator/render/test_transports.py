"""Services of each transport, and the addresses that the robot is told."""

from __future__ import annotations

import copy
from typing import Any

import pytest

from robot_offload import transport
from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.kube.port import Manifest
from robot_offload.objects.facts import Endpoint
from robot_offload.transport import carried
from robot_offload_lab.wire import dds_options
from tests.unit.operator.render.given import TRANSPORTS, facts, offload, rendered


def services(resource: RobotOffload) -> dict[str, Manifest]:
    found = rendered(resource, facts())
    return {one["metadata"]["name"]: one for key, one in found.items() if key.startswith("Service/")}


def live(resource: RobotOffload, **ingress: dict[str, str]) -> list[Manifest]:
    """The Services as a cluster shows them: node ports given out, a cluster address, ingress where told."""
    found = copy.deepcopy(list(services(resource).values()))
    for index, one in enumerate(found):
        one["spec"]["clusterIP"] = f"10.96.0.{index}"
        for number, port in enumerate(one["spec"]["ports"]):
            port.setdefault("nodePort", 30000 + 10 * index + number)
        word = one["metadata"]["name"].removeprefix("wheelchair-7-").replace("-", "_")
        if word in ingress:
            one["status"] = {"loadBalancer": {"ingress": [ingress[word]]}}
    return found


def node(name: str, *addresses: tuple[str, str], ready: bool = True) -> Manifest:
    return {
        "metadata": {"name": name},
        "status": {
            "conditions": [{"type": "Ready", "status": str(ready)}],
            "addresses": [{"type": kind, "address": address} for kind, address in addresses],
        },
    }


def ports(service: Manifest) -> list[tuple[str, str, int, int | None]]:
    return [(one["name"], one["protocol"], one["port"], one.get("nodePort")) for one in service["spec"]["ports"]]


def zenoh(**expose: Any) -> RobotOffload:
    return offload(transport={"type": "Zenoh", "expose": expose})


def test_zenoh_has_one_service_for_udp_and_one_for_tcp() -> None:
    found = services(offload())
    assert ports(found["wheelchair-7-udp"]) == [("pulse", "UDP", 7447, None), ("data", "UDP", 7448, None)]
    assert ports(found["wheelchair-7-tcp"]) == [
        ("pulse-fallback", "TCP", 7447, None),
        ("data-fallback", "TCP", 7448, None),
    ]


def test_without_a_fallback_nothing_listens_on_tcp() -> None:
    resource = offload(transport={"type": "Zenoh", "zenoh": {"fallback": False}})
    manifests = rendered(resource)
    assert "Service/wheelchair-7-tcp" not in manifests
    agent = manifests["Deployment/wheelchair-7-agent"]["spec"]["template"]["spec"]["containers"][0]
    assert {one["protocol"] for one in agent["ports"]} == {"UDP"}
    allowed = manifests["NetworkPolicy/wheelchair-7-agent"]["spec"]["ingress"][0]["ports"]
    assert {one["protocol"] for one in allowed} == {"UDP"}


def test_robots_share_one_address_on_ports_of_their_own() -> None:
    block = {"type": "Zenoh", "zenoh": {"pulsePort": 17447, "dataPort": 17448}}
    expose = {"address": "203.0.113.5", "annotations": {"example.com/shared": "robots"}, "loadBalancerClass": "a/b"}
    resource = offload(transport={**block, "expose": expose})
    udp = services(resource)["wheelchair-7-udp"]
    assert udp["spec"]["loadBalancerIP"] == "203.0.113.5"
    assert udp["spec"]["loadBalancerClass"] == "a/b"
    assert udp["metadata"]["annotations"] == {"example.com/shared": "robots"}
    assert [(one["port"], one["targetPort"]) for one in udp["spec"]["ports"]] == [(17447, "pulse"), (17448, "data")]
    assert "annotations" not in services(resource)["wheelchair-7-agent"]["metadata"]


@pytest.mark.parametrize("transport_type", ["Zenoh", "DDSRouter", "DiscoveryServer"])
def test_the_load_balancer_lets_only_the_declared_ranges_through(transport_type: str) -> None:
    expose = {"sourceRanges": ["198.51.100.0/24"]}
    found = services(offload(transport={"type": transport_type, "expose": expose}))
    outside = [one["spec"] for one in found.values() if one["spec"]["type"] == "LoadBalancer"]
    assert outside
    assert all(one["loadBalancerSourceRanges"] == ["198.51.100.0/24"] for one in outside)
    declared = offload(transport={"type": transport_type})
    assert "loadBalancerSourceRanges" not in str(services(declared))


def test_before_the_load_balancer_answers_no_address_is_known() -> None:
    assert transport.observed_endpoints(offload(), live(offload()), []) == ()


def test_the_addresses_of_both_load_balancers_are_told_with_their_purposes() -> None:
    seen = live(offload(), udp={"ip": "203.0.113.5"}, tcp={"hostname": "lb.example"})
    assert transport.observed_endpoints(offload(), seen, []) == (
        Endpoint("pulse", "UDP", "203.0.113.5", 7447),
        Endpoint("data", "UDP", "203.0.113.5", 7448),
        Endpoint("pulse-fallback", "TCP", "lb.example", 7447),
        Endpoint("data-fallback", "TCP", "lb.example", 7448),
    )


def test_a_declared_name_is_told_once_the_load_balancer_has_an_address() -> None:
    resource = zenoh(host="edge.example")
    assert transport.observed_endpoints(resource, live(resource), []) == ()
    seen = live(resource, udp={"ip": "203.0.113.5"}, tcp={"ip": "203.0.113.5"})
    assert {one.host for one in transport.observed_endpoints(resource, seen, [])} == {"edge.example"}


def test_on_node_ports_the_robot_is_told_three_ready_nodes_by_their_outside_addresses() -> None:
    resource = zenoh(type="NodePort")
    nodes = [
        node("d", ("InternalIP", "192.0.2.4")),
        node("b", ("InternalIP", "192.0.2.2"), ("ExternalIP", "198.51.100.2")),
        node("a", ("InternalIP", "192.0.2.1"), ready=False),
        node("c", ("Hostname", "c"), ("InternalIP", "192.0.2.3")),
        node("e", ("InternalIP", "192.0.2.5")),
    ]
    found = transport.observed_endpoints(resource, live(resource), nodes)
    pulse = [(one.host, one.port) for one in found if one.purpose == "pulse"]
    assert [host for host, _ in pulse] == ["198.51.100.2", "192.0.2.3", "192.0.2.4"]
    assert len({port for _, port in pulse}) == 1
    assert found == transport.observed_endpoints(resource, live(resource), nodes[::-1])


def test_declared_node_ports_are_asked_for() -> None:
    chosen = {"pulse": 30447, "data": 30448, "pulseFallback": 30449, "dataFallback": 30450}
    found = services(zenoh(type="NodePort", nodePorts=chosen))
    given = [one[3] for name in ("udp", "tcp") for one in ports(found[f"wheelchair-7-{name}"])]
    assert given == [30447, 30448, 30449, 30450]


def test_inside_the_clusters_own_network_the_service_address_is_told() -> None:
    resource = zenoh(type="ClusterIP")
    hosts = {one.host for one in transport.observed_endpoints(resource, live(resource), [])}
    assert len(hosts) == 2
    assert all(host.startswith("10.96.0.") for host in hosts)


def test_a_service_that_still_has_its_old_type_is_no_address_of_the_new_one() -> None:
    seen = live(zenoh(type="NodePort"))
    assert transport.observed_endpoints(offload(), seen, [node("a", ("InternalIP", "192.0.2.1"))]) == ()


def test_services_of_other_resources_are_left_alone() -> None:
    other = live(offload(), udp={"ip": "203.0.113.5"}, tcp={"ip": "203.0.113.5"})
    for one in other:
        one["metadata"]["name"] = one["metadata"]["name"].replace("wheelchair-7", "wheelchair-8")
    assert transport.observed_endpoints(offload(), other, []) == ()


def test_every_discovery_server_is_reached_from_outside_in_the_order_of_its_id() -> None:
    resource = offload(transport=TRANSPORTS["DiscoveryServer"])
    one, both = ({"discovery_0": {"ip": "203.0.113.8"}}, {"discovery_1": {"ip": "203.0.113.9"}})
    assert transport.observed_endpoints(resource, live(resource, **one), []) == ()
    found = transport.observed_endpoints(resource, live(resource, **one, **both), [])
    assert [(each.purpose, each.host, each.port) for each in found] == [
        ("discovery", "203.0.113.8", 11811),
        ("discovery", "203.0.113.9", 11811),
    ]
    environment = transport.of(resource.spec).robot_environment(resource, found)
    assert environment["ROS_DISCOVERY_SERVER"] == "203.0.113.8:11811;203.0.113.9:11811"


def test_further_discovery_servers_take_the_next_node_ports() -> None:
    expose = {"type": "NodePort", "nodePorts": {"discovery": 31811}}
    found = services(offload(transport={"type": "DiscoveryServer", "expose": expose}))
    assert [ports(found[f"wheelchair-7-discovery-{server}"])[0][3] for server in (0, 1)] == [31811, 31812]


@pytest.mark.parametrize("name", [name for name in TRANSPORTS if name != "DiscoveryServer"])
def test_the_discovery_servers_of_other_transports_stay_inside(name: str) -> None:
    found = services(offload(transport=TRANSPORTS[name]))
    assert all(one["spec"]["type"] == "ClusterIP" for key, one in found.items() if "-discovery-" in key)


@pytest.mark.parametrize(("servers", "transport_name"), [(1, "Zenoh"), (4, "DDSRouter"), (3, "DiscoveryServer")])
def test_as_many_discovery_servers_run_as_are_asked_for(servers: int, transport_name: str) -> None:
    resource = offload({"cloud.discoveryServers": servers}, transport=TRANSPORTS[transport_name])
    manifests = rendered(resource)
    assert len([key for key in manifests if key.startswith("StatefulSet/")]) == servers
    assert transport.discovery_servers(resource.spec) == servers


def test_static_peers_expose_nothing() -> None:
    resource = offload(transport=TRANSPORTS["StaticPeers"])
    assert list(services(resource)) == ["wheelchair-7-agent"]
    assert transport.observed_endpoints(resource, live(resource), []) == ()
    assert transport.of(resource.spec).purposes(resource) == ()


def test_the_same_topics_cross_in_a_cluster_and_on_one_machine() -> None:
    spec = offload({"nodes.1.outputs.0.mirror": True}).spec
    assert set(carried.topics(spec)) == {one.topic for one in dds_options.carried(spec)}


@pytest.mark.parametrize(
    ("expose", "allocated"),
    [
        ({}, False),
        ({"type": "NodePort"}, None),
        ({"type": "LoadBalancer", "nodePorts": {"pulse": 30001, "data": 30002}}, None),
    ],
)
def test_a_cluster_may_save_its_node_ports_where_load_balancers_need_none(
    expose: dict[str, Any], allocated: bool | None
) -> None:
    resource = offload(transport={"type": "Zenoh", "expose": expose, "zenoh": {"fallback": False}})
    service = rendered(resource, facts(load_balancer_node_ports=False))["Service/wheelchair-7-udp"]
    assert service["spec"].get("allocateLoadBalancerNodePorts") == allocated
