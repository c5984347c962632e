"""Facts of a cluster and resources for the tests of rendering."""

from __future__ import annotations

import copy
import dataclasses
from typing import Any

from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload.kube.port import Manifest
from robot_offload.objects.facts import Endpoint, Facts, Images
from robot_offload.objects.parent import Parent
from robot_offload.render.children import children
from tests.unit.specs import sample

IMAGES = Images(
    agent="registry.example/agent:1",
    operator="registry.example/operator:1",
    discovery="registry.example/discovery:1",
    router="registry.example/router:1",
    git="registry.example/git:1",
)
FACTS = Facts(
    namespace="robots",
    uid="6f1c2d34-0000-4000-8000-000000000001",
    generation=3,
    images=IMAGES,
    nodes_wanted=True,
    discovery_hosts=("10.96.0.8", "10.96.0.9"),
    certificate_hash="c1",
)
ROUTER = Endpoint("router", "TCP", "203.0.113.7", 11666)
EVERY_ENDPOINT = (
    Endpoint("pulse", "UDP", "203.0.113.5", 7447),
    Endpoint("data", "UDP", "203.0.113.5", 7448),
    Endpoint("pulse-fallback", "TCP", "203.0.113.6", 7447),
    Endpoint("data-fallback", "TCP", "203.0.113.6", 7448),
    Endpoint("discovery", "UDP", "203.0.113.8", 11811),
    Endpoint("discovery", "UDP", "203.0.113.9", 11811),
    ROUTER,
)
TRANSPORTS: dict[str, dict[str, Any]] = {
    "Zenoh": {"type": "Zenoh"},
    "DDSRouter": {"type": "DDSRouter"},
    "DiscoveryServer": {"type": "DiscoveryServer"},
    "StaticPeers": {"type": "StaticPeers", "staticPeers": {"robot": ["192.0.2.7"], "cloud": ["192.0.2.8"]}},
}


def facts(**changes: Any) -> Facts:
    """The facts of a cluster where everything is there, with changes."""
    return dataclasses.replace(FACTS, **changes)


def offload(changes: dict[str, Any] | None = None, **spec: Any) -> RobotOffload:
    """The sample, its specification changed: `changes` by paths (`nodes.1.env`), `spec` by first-level fields."""
    return parse_object(resource(changes, **spec), "test.yaml")


def resource(changes: dict[str, Any] | None = None, **spec: Any) -> dict[str, Any]:
    """The same as plain values."""
    values = sample()
    values["spec"]["nodes"][2]["image"] = "registry.example/planner:1"
    values["spec"].update(copy.deepcopy(spec))
    if values["spec"]["transport"].get("type") in ("DiscoveryServer", "StaticPeers"):
        del values["spec"]["cloud"]["domainID"]  # these two join both sides in one domain
    for path, value in (changes or {}).items():
        _put(values["spec"], path.split("."), value)
    return values


def _put(target: Any, path: list[str], value: Any) -> None:
    *parents, last = path
    for part in parents:
        target = target[int(part)] if part.isdigit() else target.setdefault(part, {})
    target[int(last) if last.isdigit() else last] = value


def rendered(wanted: RobotOffload | None = None, known: Facts | None = None) -> dict[str, Manifest]:
    """All children by `Kind/name`."""
    return by_key(children(Parent(wanted or offload(), known or FACTS)))


def by_key(manifests: tuple[Manifest, ...]) -> dict[str, Manifest]:
    """Objects by `Kind/name`; two of one name are a mistake."""
    found = {f"{one['kind']}/{one['metadata']['name']}": one for one in manifests}
    assert len(found) == len(manifests)
    return found


def pods(manifests: dict[str, Manifest]) -> dict[str, Manifest]:
    """The pod templates of all workloads, by `Kind/name`."""
    return {key: one["spec"]["template"] for key, one in manifests.items() if "template" in one.get("spec", {})}


def environment(container: Manifest) -> dict[str, str]:
    """A container's environment."""
    return {one["name"]: one["value"] for one in container["env"]}
