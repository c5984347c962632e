"""The DDS Router: exactly the declared topics, each one way, and a check of our own because it ignores unknown keys."""

from __future__ import annotations

import copy
from typing import Any
from xml.etree import ElementTree

import pytest
import yaml

from robot_offload.objects.facts import Endpoint
from robot_offload.objects.parent import Parent
from robot_offload.render.bundle import BundleSecrets, bundle
from robot_offload.transport import dds_router_config as router
from robot_offload.transport import dds_router_xml as xml
from tests.unit.operator.render.given import ROUTER, facts, offload, rendered

NAME = "wheelchair-7-router"
SECRETS = BundleSecrets(b"ca", b"certificate", b"key")
TO_ROBOT = {
    "rt/connectivity_test_remote": "std_msgs::msg::dds_::Header_",
    "rt/offload/link/cloud/probe": "std_msgs::msg::dds_::UInt8MultiArray_",
    "rt/offload/link/cloud/report": "std_msgs::msg::dds_::UInt8MultiArray_",
    "rt/offload/link/cloud/out_cmd_vel": "std_msgs::msg::dds_::UInt8MultiArray_",
}


def in_the_cloud(key: str = "router.yaml", **block: Any) -> dict[str, Any]:
    resource = offload(transport={"type": "DDSRouter", **block})
    found: dict[str, Any] = yaml.safe_load(rendered(resource)[f"ConfigMap/{NAME}"]["data"][key])
    return found


def on_the_robot(key: str = "ddsrouter.yaml", *endpoints: Endpoint, **block: Any) -> dict[str, Any]:
    resource = offload(transport={"type": "DDSRouter", **block})
    files = bundle(Parent(resource, facts(endpoints=endpoints or (ROUTER,))), SECRETS)
    found: dict[str, Any] = yaml.safe_load(files[key])
    return found


def crossing(document: dict[str, Any], topic: str) -> set[tuple[str, str]]:
    """From which participant to which one a topic is carried, as the router decides it."""
    own = [entry["routes"] for entry in document["topic-routes"] if entry["name"] == topic]
    routes = own[0] if own else document["routes"]
    return {(route["src"], target) for route in routes for target in route.get("dst", ())}


def test_the_router_needs_no_address_of_the_cloud() -> None:
    keys = rendered(offload(transport={"type": "DDSRouter"})).keys()
    assert {f"ConfigMap/{NAME}", f"Deployment/{NAME}", f"Service/{NAME}", f"NetworkPolicy/{NAME}"} <= keys
    assert "203.0.113.7" not in str(on_the_robot())


def test_both_sides_speak_version_5_and_allow_the_same_topics() -> None:
    cloud, robot = in_the_cloud(), on_the_robot()
    assert cloud["version"] == robot["version"] == "v5.0"
    assert cloud["allowlist"] == robot["allowlist"]


def test_exactly_the_declared_topics_and_the_agents_own_cross() -> None:
    assert [one["name"] for one in in_the_cloud()["allowlist"]] == [
        "rt/connectivity_test_local",
        "rt/offload/link/robot/probe",
        "rt/offload/link/robot/report",
        "rt/offload/link/robot/out_cmd_vel",
        "rt/scan",
        "rt/odom",
        "rt/goal_pose",
        *TO_ROBOT,
    ]


def test_towards_the_robot_nothing_crosses_but_what_the_clouds_agent_sends() -> None:
    resource = {"type": "DDSRouter"}
    values = offload({"nodes.1.outputs.0.mirror": True}, transport=resource)
    robot = yaml.safe_load(bundle(Parent(values, facts(endpoints=(ROUTER,))), SECRETS)["ddsrouter.yaml"])
    cloud = yaml.safe_load(rendered(values)[f"ConfigMap/{NAME}"]["data"]["router.yaml"])
    names = [one["name"] for one in robot["allowlist"]]
    assert "rt/cmd_vel" in names
    for name in names:
        back = name in TO_ROBOT
        assert crossing(robot, name) == {("Wan", "Robot") if back else ("Robot", "Wan")}
        assert crossing(cloud, name) == {("Cluster", "Wan") if back else ("Wan", "Cluster")}
    assert {one["name"]: one["type"] for one in robot["topic-routes"]} == TO_ROBOT


def test_a_topic_is_opened_by_who_publishes_it() -> None:
    assert in_the_cloud()["specs"]["discovery-trigger"] == on_the_robot()["specs"]["discovery-trigger"] == "writer"


def test_the_cloud_joins_its_discovery_servers_and_the_robot_its_own_domain() -> None:
    [cluster] = [one for one in in_the_cloud()["participants"] if one["kind"] != "xml"]
    assert (cluster["kind"], cluster["domain"]) == ("local-discovery-server", 43)
    assert [one["ip"] for one in cluster["connection-addresses"]] == ["10.96.0.8", "10.96.0.9"]
    [local] = [one for one in on_the_robot()["participants"] if one["kind"] != "xml"]
    assert (local["kind"], local["domain"]) == ("local", 42)
    [other] = [one for one in on_the_robot(ddsRouter={"domainID": 9})["participants"] if one["kind"] != "xml"]
    assert other["domain"] == 9


def test_the_routers_meet_inside_the_tunnel_and_send_at_once() -> None:
    for document, listens in ((in_the_cloud(), True), (on_the_robot(), False)):
        [wan] = [one for one in document["participants"] if one["kind"] == "xml"]
        root = ElementTree.fromstring(document["xml"]["raw"])
        names = {"x": xml.NAMESPACE}
        [participant] = root.findall(".//x:participant", names)
        assert participant.get("profile_name") == wan["profile"]
        assert [one.text for one in root.findall(".//x:enable_tcp_nodelay", names)] == ["true"]
        assert [one.text for one in root.findall(".//x:listening_ports/x:port", names)] == ["11668"] * listens
        # 3 s by itself: inputs would stay stale for so long after a cut.
        assert root.find(".//x:data_writer[@is_default_profile='true']//x:heartbeat_period", names) is not None
        addresses = {one.text for one in root.findall(".//x:address", names)}
        assert addresses == {"127.0.0.1"}
        assert {one.text for one in root.findall(".//x:physical_port", names)} == {"11667"}


def test_only_the_tunnel_is_reached_from_outside() -> None:
    manifests = rendered(offload(transport={"type": "DDSRouter"}))
    containers = {one["name"]: one for one in manifests[f"Deployment/{NAME}"]["spec"]["template"]["spec"]["containers"]}
    assert containers.keys() == {"router", "tunnel"}
    assert "ports" not in containers["router"]
    [port] = containers["tunnel"]["ports"]
    [service] = manifests[f"Service/{NAME}"]["spec"]["ports"]
    assert (port["containerPort"], service["targetPort"]) == (11666, port["name"])


def test_no_probe_connects_to_the_router_or_the_tunnel() -> None:
    manifests = rendered(offload(transport={"type": "DDSRouter"}))
    for container in manifests[f"Deployment/{NAME}"]["spec"]["template"]["spec"]["containers"]:
        assert container["readinessProbe"].keys() & {"exec", "tcpSocket", "httpGet", "grpc"} == {"exec"}


def test_both_ends_of_the_tunnel_prove_who_they_are() -> None:
    cloud, robot = in_the_cloud("tunnel.yaml"), on_the_robot("tunnel.yaml")
    folder = "/etc/robot-offload/wheelchair-7/certificates"
    assert [robot[key] for key in ("ca", "certificate", "private_key")] == [
        f"{folder}/{one}" for one in ("ca.pem", "robot.pem", "robot.key")
    ]
    assert [cloud[key].rpartition("/")[2] for key in ("ca", "certificate", "private_key")] == [
        "ca.crt", "tls.crt", "tls.key",
    ]  # fmt: skip
    assert robot["verify_name"] is False
    assert on_the_robot("tunnel.yaml", expose={"host": "edge.example"})["verify_name"] is True


def test_the_robot_dials_every_address_that_the_cluster_gives() -> None:
    more = (ROUTER, Endpoint("router", "TCP", "2001:db8::1", 30666), Endpoint("router", "TCP", "edge.example", 9))
    found = on_the_robot("tunnel.yaml", *more)
    assert found["connect"] == ["203.0.113.7:11666", "[2001:db8::1]:30666", "edge.example:9"]
    assert found["listen"] == "127.0.0.1:11667"


GOOD = router.config(
    {
        "name": "Cluster",
        "kind": "local-discovery-server",
        "domain": 3,
        "connection-addresses": [router.address("10.96.0.8", 11811, "udp")],
    },
    xml.PROFILE,
    xml.profile(listening=xml.LISTENING),
    ["/scan"],
    {"/beat": "std_msgs/msg/Header"},
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
        ("allowlist.0.name", "rq/scan", "is not a topic of ROS 2"),
        ("participants.0.kind", "simpel", "participants[0].kind: 'simpel' is none of"),
        ("participants.0.domain", 300, "not within 0 .. 232"),
        ("participants.1.name", "Cluster", "each name once"),
        ("participants.1.profile", "", "profile: is needed"),
        ("participants.0.connection-addresses", [], "needs an address"),
        ("participants.0.connection-addresses.0.transport", "quic", "must be tcp or udp"),
        ("participants.0.connection-addresses.0.ip", "0.0.0.0", "no connection is possible"),
        ("participants.0.connection-addresses.0.ip", "", "ip: is needed"),
        ("participants.0.connection-addresses.0.port", 0, "is not a port"),
        ("participants.0.tls", {}, "tls: the router does not know"),
        ("routes", [], "forwards everywhere"),
        ("routes.0.src", "Robot", "'Robot' is not a participant"),
        ("routes.1.dst", ["Wan"], "cross both ways"),
        ("topic-routes.0.type", "", "type: is needed"),
        ("topic-routes.0.name", "rt/other", "not in the allowlist"),
        ("topic-routes.0.routes.1", {"src": "Wan", "to": []}, "to: the router does not know"),
        ("xml.file", "x", "xml.file: the router does not know"),
    ],
)
def test_what_the_router_would_refuse_or_misread_is_told(path: str, value: Any, told: str) -> None:
    assert any(told in line for line in broken(path, value)), broken(path, value)


def test_a_bad_configuration_is_never_rendered() -> None:
    with pytest.raises(router.RouterConfigError, match="is not a topic"):
        router.config({"name": "Robot", "kind": "local", "domain": 1}, "p", "", ["scan"], {})
