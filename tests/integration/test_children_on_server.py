"""A real API server takes all that we render, in a namespace of the restricted Pod Security level, and keeps it."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import pytest
import yaml

from robot_offload import transport
from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload.render.children import children
from robot_offload.render.facts import Endpoint, Facts, Manifest
from tests.cluster.commands import Kubectl
from tests.cluster.control_plane import ControlPlane
from tests.unit.render.given import EVERY_ENDPOINT, by_key, facts, resource

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
RESOURCES: dict[str, dict[str, Any]] = {
    "everything": resource(EVERYTHING),
    "openshift": resource({"cloud.runAsUser": None}),
    "discovery by node ports": resource(
        transport={"type": "DiscoveryServer", "expose": {"type": "NodePort", "nodePorts": {"discovery": 31811}}},
    ),
    **SAMPLES,
}
RUNTIME_CLASS = {
    "apiVersion": "node.k8s.io/v1",
    "kind": "RuntimeClass",
    "metadata": {"name": "nvidia"},
    "handler": "nvidia",
}
OPTIONS = ("--server-side", "--field-manager=robot-offload", "--validate=strict")


def created(kubectl: Kubectl, values: dict[str, Any]) -> tuple[RobotOffload, Facts]:
    """The resource in the cluster, and the facts that the controller would gather."""
    kubectl.apply(values, RUNTIME_CLASS)
    live = kubectl.json("get", "robotoffload", values["metadata"]["name"])
    known = facts(
        namespace=kubectl.namespace,
        uid=live["metadata"]["uid"],
        generation=live["metadata"]["generation"],
        robot_connected=True,
        endpoints=EVERY_ENDPOINT,
    )
    return parse_object(live, "cluster", unknown="ignore"), known


def live(kubectl: Kubectl, manifests: tuple[Manifest, ...]) -> dict[str, Manifest]:
    """What the server made of them."""
    found = json.loads(
        kubectl("get", "-o", "json", *(f"{m['kind'].lower()}/{m['metadata']['name']}" for m in manifests))
    )
    return {f"{one['kind']}/{one['metadata']['name']}": one for one in found["items"]}


@pytest.fixture
def restricted(control_plane: ControlPlane, restricted_namespace: str) -> Kubectl:
    return control_plane.kubectl(restricted_namespace)


@pytest.mark.parametrize("name", RESOURCES)
def test_every_child_is_taken_kept_and_left_alone_by_a_second_apply(restricted: Kubectl, name: str) -> None:
    rendered = children(*created(restricted, RESOURCES[name]))
    restricted.apply(*rendered, options=OPTIONS)
    first = live(restricted, rendered)
    assert [lost for key, one in by_key(rendered).items() for lost in missing(one, first[key], key)] == []
    assert pods_refused(restricted) == []
    restricted.apply(*rendered, options=OPTIONS)
    assert versions(live(restricted, rendered)) == versions(first)


def pods_refused(kubectl: Kubectl) -> list[str]:
    """Waits until every workload has the pods that it wants, or says why it gets none, e.g. by Pod Security."""
    deadline_s = time.monotonic() + 60
    while time.monotonic() < deadline_s:
        workloads = kubectl.json("get", "deployments,statefulsets,replicasets")["items"]
        refused = [
            f"{one['metadata']['name']}: {condition['message']}"
            for one in workloads
            for condition in one.get("status", {}).get("conditions", [])
            if condition["type"] == "ReplicaFailure"
        ]
        if refused or all(one.get("status", {}).get("replicas", 0) == one["spec"]["replicas"] for one in workloads):
            return refused
        time.sleep(0.2)
    return [f"{one['metadata']['name']}: no pod after a minute" for one in workloads]


def versions(found: dict[str, Manifest]) -> dict[str, tuple[int | None, str | None]]:
    """How often the server saw each specification change; for what no controller writes to, how often anything."""
    quiet = ("ConfigMap", "Service", "Lease", "Role", "RoleBinding", "NetworkPolicy", "ServiceAccount")
    return {
        key: (
            one["metadata"].get("generation"),
            one["metadata"]["resourceVersion"] if one["kind"] in quiet else None,
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


def test_node_ports_that_the_cluster_chooses_become_endpoints(restricted: Kubectl) -> None:
    offload, known = created(restricted, resource(transport={"type": "Zenoh", "expose": {"type": "NodePort"}}))
    restricted.apply(*children(offload, known), options=OPTIONS)
    services = restricted.json("get", "services")["items"]
    node = {
        "metadata": {"name": "edge-1"},
        "status": {
            "conditions": [{"type": "Ready", "status": "True"}],
            "addresses": [{"type": "InternalIP", "address": "192.0.2.11"}],
        },
    }
    found = transport.observed_endpoints(offload, services, [node])
    assert [one.purpose for one in found] == ["pulse", "data", "pulse-fallback", "data-fallback"]
    assert {one.host for one in found} == {"192.0.2.11"}
    assert len({one.port for one in found}) == 4
    assert all(30000 <= one.port <= 32767 for one in found)


def test_one_node_port_cannot_serve_udp_and_tcp_in_two_services(restricted: Kubectl) -> None:
    """Why `expose.nodePorts` has four numbers: the server gives out node ports by number alone."""
    ports = {"pulse": 31551, "data": 31552, "pulseFallback": 31553, "dataFallback": 31554}
    values = resource(transport={"type": "Zenoh", "expose": {"type": "NodePort", "nodePorts": ports}})
    rendered = children(*created(restricted, values))
    [tcp] = [one for one in rendered if one["metadata"]["name"] == "wheelchair-7-tcp"]
    tcp["spec"]["ports"][0]["nodePort"] = ports["pulse"]
    assert "port is already allocated" in restricted.apply_refused(*rendered, options=OPTIONS)


def test_the_router_waits_for_its_address_and_then_announces_it(
    control_plane: ControlPlane, restricted: Kubectl
) -> None:
    offload, known = created(restricted, resource(transport={"type": "DDSRouter"}))
    first = children(offload, facts(namespace=known.namespace, uid=known.uid))
    restricted.apply(*first, options=OPTIONS)
    assert "deployment.apps/wheelchair-7-router" not in restricted.names("deployments")
    service = "wheelchair-7-router"
    status = {"status": {"loadBalancer": {"ingress": [{"ip": "203.0.113.77"}]}}}
    restricted("patch", "service", service, "--subresource=status", "--type=merge", f"--patch={json.dumps(status)}")
    found = transport.observed_endpoints(offload, restricted.json("get", "services")["items"], [])
    assert found == (Endpoint("router", "TCP", "203.0.113.77", 11666),)
    second = children(offload, facts(namespace=known.namespace, uid=known.uid, endpoints=found))
    restricted.apply(*second, options=OPTIONS)
    text = restricted.json("get", "configmap", service)["data"]["router.yaml"]
    [wan] = [one for one in yaml.safe_load(text)["participants"] if one["kind"] == "wan"]
    assert wan["listening-addresses"][0]["ip"] == "203.0.113.77"
    restricted("wait", "--for=create", "pods", "-l", "app.kubernetes.io/component=router", "--timeout=30s")


def test_all_children_go_away_with_the_resource(restricted: Kubectl) -> None:
    offload, known = created(restricted, resource())
    rendered = children(offload, known)
    restricted.apply(*rendered, options=OPTIONS)
    restricted("delete", "robotoffload", offload.metadata.name)
    kinds = ",".join(sorted({one["kind"].lower() for one in rendered} | {"pod"}))
    selector = f"app.kubernetes.io/instance={offload.metadata.name}"
    restricted("wait", "--for=delete", kinds, "-l", selector, "--timeout=50s")
    assert restricted.names(kinds, "-l", selector) == []
