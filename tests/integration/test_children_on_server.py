"""A real API server takes all that we render, in a namespace of the restricted Pod Security level, and keeps it."""

from __future__ import annotations

import json
import time
import urllib.error
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest
import yaml

from robot_offload import transport
from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload.kube.kinds import DEPLOYMENT, SERVICE, STATEFUL_SET, Kind, kind_of
from robot_offload.kube.port import Manifest
from robot_offload.objects.facts import Endpoint, Facts
from robot_offload.objects.parent import Parent
from robot_offload.render.children import children
from robot_offload_lab.cluster.control_plane import ControlPlane
from tests.integration.operator_cluster import eventually
from tests.unit.operator.render.given import EVERY_ENDPOINT, TRANSPORTS, by_key, facts, resource

pytestmark = pytest.mark.api

SAMPLES = {
    f"{file.stem}/{document['metadata']['name']}": document
    for file in sorted(Path(__file__).parents[2].glob("manifests/samples/*.yaml"))
    for document in yaml.safe_load_all(file.read_text())
    if document["kind"] == "RobotOffload"
}
EVERYTHING = {
    "cloud.nodeSelector": {"pool": "edge"},
    "cloud.tolerations": [{"key": "edge", "operator": "Exists", "effect": "NoExecute", "tolerationSeconds": 60}],
    "cloud.imagePullSecrets": [{"name": "registry"}],
    "nodes.1.resources": {"limits": {"nvidia.com/gpu": 1, "memory": "1Gi"}, "requests": {"cpu": "500m"}},
    "nodes.1.runtimeClassName": "nvidia",
    "nodes.1.nodeSelector": {"accelerator": "gpu"},
    "nodes.1.env": [{"name": "RCUTILS_COLORIZED_OUTPUT", "value": "0"}],
    "nodes.1.imagePullPolicy": "Always",
    "nodes.1.run.parametersFrom": {"configMapKeyRef": {"name": "nav", "key": "nav.yaml"}},
}
# Node ports that are named are below 30086: the API server gives those to nobody by itself.
RESOURCES: dict[str, dict[str, Any]] = {
    "everything": resource(EVERYTHING),
    "openshift": resource({"cloud.runAsUser": None}),
    "discovery by node ports": resource(
        transport={"type": "DiscoveryServer", "expose": {"type": "NodePort", "nodePorts": {"discovery": 30081}}},
    ),
    **SAMPLES,
}
RUNTIME_CLASS = {
    "apiVersion": "node.k8s.io/v1",
    "kind": "RuntimeClass",
    "metadata": {"name": "nvidia"},
    "handler": "nvidia",
}
REPLICA_SET = Kind("apps/v1", "ReplicaSet", "replicasets")
QUIET = ("ConfigMap", "Service", "Lease", "Role", "RoleBinding", "NetworkPolicy", "ServiceAccount")
"""Kinds that no controller writes to here, so that their version changes only when somebody applies a change."""


@dataclass(frozen=True)
class Place:
    """A namespace on the server. Requests are sent straight to it: kubectl takes a second for each of them."""

    plane: ControlPlane
    namespace: str

    def apply(self, *manifests: Manifest) -> list[Manifest]:
        """Applies objects as the operator does, and lets no unknown field pass."""
        return [self._apply(one) for one in manifests]

    def _apply(self, manifest: Manifest) -> Manifest:
        path = f"{self._path(manifest)}?fieldManager=robot-offload&fieldValidation=Strict"
        try:
            answer = self.plane.request("PATCH", path, manifest, "application/apply-patch+yaml")
        except urllib.error.HTTPError as error:
            message = json.loads(error.read())["message"]
            raise AssertionError(f"{manifest['kind']} {manifest['metadata']['name']}: {message}") from error
        found: Manifest = json.loads(answer)
        return found

    def read(self, *manifests: Manifest) -> dict[str, Manifest]:
        """What the server made of objects."""
        return by_key(tuple(json.loads(self.plane.get(self._path(one))) for one in manifests))

    def list(self, kind: Kind) -> list[Manifest]:
        """All objects of a kind."""
        found: list[Manifest] = json.loads(self.plane.get(kind.path(self.namespace)))["items"]
        return found

    def create(self, values: dict[str, Any]) -> tuple[RobotOffload, Facts]:
        """The resource in the cluster, and the facts that the controller would gather."""
        [live] = self.apply(values)
        known = facts(
            namespace=self.namespace,
            uid=live["metadata"]["uid"],
            generation=live["metadata"]["generation"],
            robot_connected=True,
            endpoints=EVERY_ENDPOINT,
        )
        return parse_object(live, "cluster", unknown="ignore"), known

    def _path(self, manifest: Manifest) -> str:
        return kind_of(manifest).path(self.namespace, manifest["metadata"]["name"])


@pytest.fixture
def restricted(control_plane: ControlPlane, restricted_namespace: str) -> Place:
    control_plane.kubectl().apply(RUNTIME_CLASS)
    return Place(control_plane, restricted_namespace)


@pytest.mark.parametrize("name", RESOURCES)
def test_every_child_is_taken_kept_and_left_alone_by_a_second_apply(restricted: Place, name: str) -> None:
    rendered = children(Parent(*restricted.create(RESOURCES[name])))
    restricted.apply(*rendered)
    first = restricted.read(*rendered)
    assert [lost for key, one in by_key(rendered).items() for lost in missing(one, first[key], key)] == []
    assert pods_refused(restricted) == []
    restricted.apply(*rendered)
    assert versions(restricted.read(*rendered)) == versions(first)


def pods_refused(place: Place) -> list[str]:
    """Waits until every workload has the pods that it wants, or says why it gets none, e.g. by Pod Security."""
    deadline_s = time.monotonic() + 60
    while True:
        workloads = [one for kind in (DEPLOYMENT, STATEFUL_SET, REPLICA_SET) for one in place.list(kind)]
        refused = [
            f"{one['metadata']['name']}: {condition['message']}"
            for one in workloads
            for condition in one["status"].get("conditions", [])
            if condition["type"] == "ReplicaFailure"
        ]
        if refused or all(one["status"].get("replicas", 0) == one["spec"]["replicas"] for one in workloads):
            return refused
        if time.monotonic() > deadline_s:
            return [f"{one['metadata']['name']}: no pod after a minute" for one in workloads]
        time.sleep(0.2)


def versions(found: dict[str, Manifest]) -> dict[str, tuple[int | None, str | None]]:
    """How often the server saw each specification change; for what no controller writes to, how often anything."""
    return {
        key: (
            one["metadata"].get("generation"),
            one["metadata"]["resourceVersion"] if one["kind"] in QUIET else None,
        )
        for key, one in found.items()
    }


def missing(wanted: Any, found: Any, path: str) -> list[str]:
    """Paths of what is wanted and not found; what the server adds is fine."""
    if isinstance(wanted, dict) and isinstance(found, dict):
        return [lost for key, value in wanted.items() for lost in missing(value, found.get(key), f"{path}.{key}")]
    if isinstance(wanted, list) and isinstance(found, list) and len(wanted) == len(found):
        pairs = enumerate(zip(wanted, found, strict=True))
        return [lost for index, (one, other) in pairs for lost in missing(one, other, f"{path}[{index}]")]
    same = wanted == found or (not wanted and found is None)
    return [] if same else [f"{path}: {wanted!r} -> {found!r}"]


def test_node_ports_that_the_cluster_chooses_become_endpoints(restricted: Place) -> None:
    offload, known = restricted.create(resource(transport={"type": "Zenoh", "expose": {"type": "NodePort"}}))
    restricted.apply(*children(Parent(offload, known)))
    node = {
        "metadata": {"name": "edge-1"},
        "status": {
            "conditions": [{"type": "Ready", "status": "True"}],
            "addresses": [{"type": "InternalIP", "address": "192.0.2.11"}],
        },
    }
    found = transport.observed_endpoints(offload, restricted.list(SERVICE), [node])
    assert [one.purpose for one in found] == ["pulse", "data", "pulse-fallback", "data-fallback"]
    assert {one.host for one in found} == {"192.0.2.11"}
    assert len({one.port for one in found}) == 4
    assert all(30000 <= one.port <= 32767 for one in found)


def test_one_node_port_cannot_serve_udp_and_tcp_in_two_services(restricted: Place) -> None:
    """Why `expose.nodePorts` has four numbers: the server gives out node ports by number alone."""
    ports = {"pulse": 30051, "data": 30052, "pulseFallback": 30053, "dataFallback": 30054}
    values = resource(transport={"type": "Zenoh", "expose": {"type": "NodePort", "nodePorts": ports}})
    rendered = children(Parent(*restricted.create(values)))
    [tcp] = [one for one in rendered if one["metadata"]["name"] == "wheelchair-7-tcp"]
    tcp["spec"]["ports"][0]["nodePort"] = ports["pulse"]
    with pytest.raises(AssertionError, match="port is already allocated"):
        restricted.apply(*rendered)


def test_the_router_runs_before_its_address_is_known(restricted: Place) -> None:
    offload, known = restricted.create(resource(transport={"type": "DDSRouter"}))
    name = "wheelchair-7-router"
    restricted.apply(*children(Parent(offload, replace(known, endpoints=()))))
    assert name in [one["metadata"]["name"] for one in restricted.list(DEPLOYMENT)]
    status = {"status": {"loadBalancer": {"ingress": [{"ip": "203.0.113.77"}]}}}
    path = SERVICE.path(restricted.namespace, name, "status")
    restricted.plane.request("PATCH", path, status, "application/merge-patch+json")
    found = transport.observed_endpoints(offload, restricted.list(SERVICE), [])
    assert found == (Endpoint("router", "TCP", "203.0.113.77", 11666),)
    assert pods_refused(restricted) == []


def test_all_children_go_away_with_the_resource(restricted: Place) -> None:
    offload, known = restricted.create(resource())
    rendered = children(Parent(offload, known))
    restricted.apply(*rendered)
    kubectl = restricted.plane.kubectl(restricted.namespace)
    kubectl("delete", "robotoffload", offload.metadata.name)
    kinds = ",".join(sorted({one["kind"].lower() for one in rendered} | {"pod"}))
    selector = f"app.kubernetes.io/instance={offload.metadata.name}"
    eventually(
        lambda: not kubectl.names(kinds, "-l", selector), "no child", lambda: kubectl.names(kinds, "-l", selector)
    )


def test_the_type_of_the_services_can_be_changed_and_changed_back(restricted: Place) -> None:
    ports = {"pulse": 30061, "data": 30062, "pulseFallback": 30063, "dataFallback": 30064}
    steps: list[dict[str, Any]] = [
        {"type": "LoadBalancer", "address": "203.0.113.5"},
        {"type": "NodePort", "nodePorts": ports},
        {"type": "ClusterIP"},
        {"type": "LoadBalancer", "loadBalancerClass": "example.com/other"},
        {"type": "NodePort"},
        {"type": "LoadBalancer", "address": "203.0.113.5"},
    ]
    for expose in steps:
        offload, known = restricted.create(resource(transport={"type": "Zenoh", "expose": expose}))
        services = [one for one in children(Parent(offload, known)) if one["kind"] == "Service"]
        restricted.apply(*services)
        udp = restricted.read(*services)["Service/wheelchair-7-udp"]["spec"]
        assert udp["type"] == expose["type"]
        assert udp.get("loadBalancerIP") == expose.get("address")
        assert udp.get("loadBalancerClass") == expose.get("loadBalancerClass")
        given = {one["nodePort"] for one in udp["ports"] if "nodePort" in one}
        assert given == {30061, 30062} or "nodePorts" not in expose
        assert not given or expose["type"] != "ClusterIP"


def test_a_transport_can_be_changed_and_changed_back(restricted: Place) -> None:
    for block in (*TRANSPORTS.values(), TRANSPORTS["Zenoh"]):
        restricted.apply(*children(Parent(*restricted.create(resource(transport=block)))))
    assert pods_refused(restricted) == []


def test_the_class_of_a_load_balancer_is_changed_by_way_of_another_type(restricted: Place) -> None:
    """Kubernetes refuses it in place; docs/how-to/transports.md says what to do."""

    def show(**expose: str) -> None:
        offload, known = restricted.create(resource(transport={"type": "Zenoh", "expose": expose}))
        restricted.apply(*[one for one in children(Parent(offload, known)) if one["kind"] == "Service"])

    show()
    with pytest.raises(AssertionError, match="loadBalancerClass"):
        show(loadBalancerClass="example.com/other")
    show(type="ClusterIP")
    show(loadBalancerClass="example.com/other")
