"""Every field of the specification does something: changing it changes what the cluster or the robot gets."""

from __future__ import annotations

import copy
import datetime
import json
from typing import Any

import pytest

from robot_offload import transport
from robot_offload.api.v1alpha1 import RobotOffload
from robot_offload.api.v1alpha1.model import Model
from robot_offload.api.v1alpha1.parsing import parse_object
from robot_offload.api.v1alpha1.rules import not_yet
from robot_offload.decide import issuer
from robot_offload.decide.builds import Before, decide
from robot_offload.objects.parent import Parent
from robot_offload.render.bundle import BundleSecrets, bundle
from robot_offload.render.children import children
from tests.contract.test_crd import FIELDS
from tests.unit.operator.render.given import EVERY_ENDPOINT, TRANSPORTS, facts, resource

BEGINNING = datetime.datetime(2026, 1, 1, tzinfo=datetime.UTC)
CONFIGS = {key: f"controller: {{ros__parameters: {{from: {key}}}}}" for key in ("a/b.yaml", "a/c.yaml", "c/b.yaml")}
SECRETS = BundleSecrets(ca=b"ca", certificate=b"certificate", private_key=b"key")
TOLERATION = {"key": "a", "operator": "Equal", "value": "b", "effect": "NoExecute", "tolerationSeconds": 3}
PULL, ENV = "cloud.imagePullSecrets", "nodes.1.env"
NODE_PORTS = "transport.expose.nodePorts"
SCAN, OUTPUT, RUN = "topics.toCloud.0", "nodes.1.outputs.0", "nodes.1.run"
BY_PACKAGE = {"package": "p", "executable": "e"}
REFERENCE = {"configMapKeyRef": {"name": "a", "key": "b.yaml"}}
ISSUED = {"transport.certificates": {"issuerRef": {"name": "a", "kind": "Issuer"}}}

BUILD = "nodes.2.build"
REGISTRY = "cloud.registry"
BLOCK: dict[str, Any] = {"git": {"url": "https://a.example/a"}, "package": "a", "executable": "a"}


def built(**besides: Any) -> dict[str, Any]:
    """What a specification has that builds the image of a node."""
    node = {"name": "planner", "placement": "Cloud", "run": BY_PACKAGE, "build": BLOCK | besides}
    return {REGISTRY: {"repository": "r.example/a"}, "nodes.2": node}


def build(field: str, first: Any, second: Any, **besides: Any) -> tuple[dict[str, Any], str, Any, Any]:
    """An entry for a field of a build block."""
    return built(**besides), f"{BUILD}.{field}", first, second


def variable(reference: str, second: dict[str, str]) -> tuple[dict[str, Any], str, Any, Any]:
    """An entry for a field of a variable's source."""
    first = {"name": "a", "key": "k"}
    return {}, ENV, *([{"name": "A", "valueFrom": {reference: each}}] for each in (first, second))


CONDITION = {"topic": "/a", "within": "50ms"}
CARRIED = {"topics.toCloud.0": {"name": "/a"}, "topics.toCloud.1": {"name": "/b"}}
FRAME = {"parent": "map", "child": "odom"}
CALL = {"name": "/a", "type": "a/srv/A"}
POOL = {"name": "p", "placement": "Cloud", "lifecycle": False, "run": BY_PACKAGE, "image": "a", "services": [CALL]}
GOAL = {"name": "/a", "type": "a/action/A"}
FOLLOW = GOAL | {"onSwitch": "Resend"}
HELD = GOAL | {"onSwitch": "Hold"}
KEPT = {"topic": "/a", "restore": "/b"}


def served(field: str, first: Any, second: Any) -> tuple[dict[str, Any], str, Any, Any]:
    """An entry for a field of the names and the state of a duplicated node that is always active."""
    return {"nodes.1.standby": {"robot": "Hot", "cloud": "Hot"}}, f"nodes.1.{field}", first, second


# Field -> (what the specification has besides, the changed place, a first and a second value).
CHANGES: dict[str, tuple[dict[str, Any], str, Any, Any]] = {
    "robot.rosDistro": ({}, "robot.rosDistro", "jazzy", "kilted"),
    "robot.rmw": ({}, "robot.rmw", "rmw_fastrtps_cpp", "rmw_fastrtps_dynamic_cpp"),
    "robot.domainID": ({}, "robot.domainID", 1, 2),
    "robot.namespace": ({}, "robot.namespace", "/", "/seven"),
    "robot.interfaces.setup": ({}, "robot.interfaces", None, {"setup": "/opt/ws/install/setup.bash"}),
    "cloud.agent.image": ({}, "cloud.agent", {}, {"image": "registry.example/agent:mine"}),
    "cloud.domainID": ({}, "cloud.domainID", 1, 2),
    "cloud.rmw": ({}, "cloud.rmw", "rmw_fastrtps_cpp", "rmw_fastrtps_dynamic_cpp"),
    "cloud.discoveryServers": ({}, "cloud.discoveryServers", 1, 2),
    "cloud.imagePullSecrets": ({}, PULL, [], [{"name": "a"}]),
    "cloud.imagePullSecrets[].name": ({}, PULL, [{"name": "a"}], [{"name": "b"}]),
    "cloud.nodeSelector": ({}, "cloud.nodeSelector", {}, {"a": "b"}),
    "cloud.tolerations": ({}, "cloud.tolerations", [], [TOLERATION]),
    "cloud.tolerations[].key": ({}, "cloud.tolerations", [TOLERATION], [TOLERATION | {"key": "c"}]),
    "cloud.tolerations[].operator": ({}, "cloud.tolerations", [{"key": "a"}], [{"key": "a", "operator": "Exists"}]),
    "cloud.tolerations[].value": ({}, "cloud.tolerations", [TOLERATION], [TOLERATION | {"value": "c"}]),
    "cloud.tolerations[].effect": ({}, "cloud.tolerations", [{"key": "a"}], [{"key": "a", "effect": "NoSchedule"}]),
    "cloud.tolerations[].tolerationSeconds": (
        {},
        "cloud.tolerations",
        [TOLERATION],
        [TOLERATION | {"tolerationSeconds": 4}],
    ),
    "cloud.podSpec": ({}, "cloud.podSpec", {}, {"priorityClassName": "robots"}),
    "cloud.runAsUser": ({}, "cloud.runAsUser", 1000, None),
    "record.switches": ({}, "record.switches", False, True),
    "record.before": ({}, "record.before", "1s", "2s"),
    "record.after": ({}, "record.after", "1s", "2s"),
    "record.keep": ({}, "record.keep", 1, 2),
    "record.maxSize": ({}, "record.maxSize", "1Mi", "2Mi"),
    "transport.type": ({}, "transport", TRANSPORTS["Zenoh"], TRANSPORTS["DDSRouter"]),
    "transport.zenoh.pulsePort": ({}, "transport.zenoh.pulsePort", 7000, 7001),
    "transport.zenoh.dataPort": ({}, "transport.zenoh.dataPort", 7000, 7001),
    "transport.zenoh.fallback": ({}, "transport.zenoh.fallback", True, False),
    "transport.ddsRouter.port": ({"transport": {"type": "DDSRouter"}}, "transport.ddsRouter", {}, {"port": 1234}),
    "transport.ddsRouter.domainID": (
        {"transport": {"type": "DDSRouter"}},
        "transport.ddsRouter",
        {},
        {"domainID": 9},
    ),
    "transport.staticPeers.robot": (
        {"transport": TRANSPORTS["StaticPeers"], "cloud": {}},
        "transport.staticPeers.robot",
        ["192.0.2.7"],
        ["192.0.2.9"],
    ),
    "transport.staticPeers.cloud": (
        {"transport": TRANSPORTS["StaticPeers"], "cloud": {}},
        "transport.staticPeers.cloud",
        ["192.0.2.8"],
        ["192.0.2.9"],
    ),
    "transport.expose.type": ({}, "transport.expose.type", "LoadBalancer", "ClusterIP"),
    "transport.expose.host": ({}, "transport.expose.host", None, "edge.example.com"),
    "transport.expose.address": ({}, "transport.expose.address", None, "192.0.2.1"),
    "transport.expose.loadBalancerClass": ({}, "transport.expose.loadBalancerClass", None, "example.com/internal"),
    "transport.expose.sourceRanges": ({}, "transport.expose.sourceRanges", None, ["198.51.100.0/24"]),
    "transport.expose.annotations": ({}, "transport.expose.annotations", {}, {"a": "b"}),
    **{
        f"{NODE_PORTS}.{purpose}": ({}, f"{NODE_PORTS}.{purpose}", None, 30001)
        for purpose in ("pulse", "data", "pulseFallback", "dataFallback")
    },
    f"{NODE_PORTS}.router": (
        {"transport": {"type": "DDSRouter", "expose": {"type": "NodePort"}}},
        f"{NODE_PORTS}.router",
        None,
        30001,
    ),
    f"{NODE_PORTS}.discovery": (
        {"transport": {"type": "DiscoveryServer", "expose": {"type": "NodePort"}}, "cloud": {}},
        f"{NODE_PORTS}.discovery",
        None,
        30001,
    ),
    "transport.certificates.issuerRef.name": (ISSUED, "transport.certificates.issuerRef.name", "a", "b"),
    "transport.certificates.issuerRef.kind": (
        ISSUED,
        "transport.certificates.issuerRef.kind",
        "Issuer",
        "ClusterIssuer",
    ),
    "transport.certificates.duration": (ISSUED, "transport.certificates.duration", "2160h", "2400h"),
    "transport.certificates.renewBefore": (ISSUED, "transport.certificates.renewBefore", "720h", "700h"),
    "topics.toCloud": ({}, "topics.toCloud", [], [{"name": "/scan"}]),
    "topics.toCloud[].name": ({}, f"{SCAN}.name", "/scan", "/scan2"),
    "topics.toCloud[].type": ({}, f"{SCAN}.type", None, "sensor_msgs/msg/Image"),
    "topics.toCloud[].maxAge": ({}, f"{SCAN}.maxAge", None, "1s"),
    "topics.toCloud[].maxRate": ({}, f"{SCAN}.maxRate", None, 3),
    "topics.toCloud[].latched": ({}, f"{SCAN}.latched", False, True),
    "topics.toCloud[].qos.reliability": ({}, f"{SCAN}.qos.reliability", "Reliable", "BestEffort"),
    "topics.toCloud[].qos.durability": ({}, f"{SCAN}.qos.durability", "Volatile", "TransientLocal"),
    "topics.toCloud[].qos.depth": ({}, f"{SCAN}.qos.depth", 10, 11),
    "driver.inhibitService": ({}, "driver.inhibitService", "/a", "/b"),
    "nodes": ({}, "nodes.0", {"name": "x", "placement": "Robot"}, {"name": "y", "placement": "Robot"}),
    "nodes[].name": ({}, "nodes.1.name", "controller", "controller2"),
    "nodes[].placement": ({}, "nodes.2.placement", "Cloud", "Duplicated"),
    "nodes[].core": ({}, "nodes.1.core", True, False),
    "nodes[].lifecycle": ({}, "nodes.2.lifecycle", True, False),
    "nodes[].replicas": ({"nodes.2": POOL}, "nodes.2.replicas", 2, 3),
    "nodes[].maxReplicas": ({"nodes.2": POOL | {"replicas": 1}}, "nodes.2.maxReplicas", 3, 4),
    "nodes[].standby.robot": ({}, "nodes.1.standby.robot", "Warm", "Hot"),
    "nodes[].standby.cloud": ({}, "nodes.1.standby.cloud", "Warm", "Cold"),
    "nodes[].run.command": ({}, f"{RUN}.command", ["a"], ["b"]),
    "nodes[].run.package": ({}, RUN, BY_PACKAGE, BY_PACKAGE | {"package": "q"}),
    "nodes[].run.executable": ({}, RUN, BY_PACKAGE, BY_PACKAGE | {"executable": "f"}),
    "nodes[].run.parameters": ({}, f"{RUN}.parameters", {"rate_hz": 3}, {"rate_hz": 4}),
    "nodes[].run.cloudParameters": ({}, f"{RUN}.cloudParameters", {"rate_hz": 3}, {"rate_hz": 4}),
    "nodes[].run.doubles": ({f"{RUN}.parameters": {"rate_hz": 20}}, f"{RUN}.doubles", [], ["rate_hz"]),
    "nodes[].run.parametersFrom.configMapKeyRef.name": (
        {f"{RUN}.parametersFrom": REFERENCE},
        f"{RUN}.parametersFrom.configMapKeyRef.name",
        "a",
        "c",
    ),
    "nodes[].run.parametersFrom.configMapKeyRef.key": (
        {f"{RUN}.parametersFrom": REFERENCE},
        f"{RUN}.parametersFrom.configMapKeyRef.key",
        "b.yaml",
        "c.yaml",
    ),
    "nodes[].run.remap": ({}, f"{RUN}.remap", {}, {"a": "b"}),
    "nodes[].image": ({}, "nodes.1.image", "a:1", "a:2"),
    "nodes[].build.base": build("base", None, "a:1"),
    "nodes[].build.runtimeBase": build("runtimeBase", None, "a:1"),
    "nodes[].build.package": build("package", "a", "b"),
    "nodes[].build.executable": build("executable", "a", "b"),
    "nodes[].build.launch": build("launch", "a.py", "b.py", executable=None),
    "nodes[].build.packages": build("packages", [], ["b"]),
    "nodes[].build.cmakeArguments": build("cmakeArguments", [], ["-DA=1"]),
    "nodes[].build.skipKeys": build("skipKeys", [], ["a"]),
    "nodes[].build.aptPackages": build("aptPackages", [], ["libyaml-cpp-dev"]),
    "nodes[].build.pipPackages": build("pipPackages", [], ["numpy"]),
    "nodes[].build.distro": build("distro", None, "kilted"),
    "nodes[].build.git.url": build("git.url", "https://a.example/a", "https://a.example/b"),
    "nodes[].build.git.ref": build("git.ref", "HEAD", "v1"),
    "nodes[].build.git.paths": build("git.paths", [], ["src"]),
    "nodes[].build.gitSecret.name": build("gitSecret", {"name": "a"}, {"name": "b"}),
    "nodes[].build.resources.limits": build("resources", {}, {"limits": {"cpu": 1}}),
    "nodes[].build.resources.requests": build("resources", {}, {"requests": {"cpu": 1}}),
    "cloud.registry.repository": (built(), f"{REGISTRY}.repository", "a.example/a", "a.example/b"),
    "cloud.registry.pushSecret.name": (built(), f"{REGISTRY}.pushSecret", {"name": "a"}, {"name": "b"}),
    "cloud.registry.pullSecret.name": (built(), f"{REGISTRY}.pullSecret", {"name": "a"}, {"name": "b"}),
    "cloud.registry.insecure": (built(), f"{REGISTRY}.insecure", False, True),
    "nodes[].imagePullPolicy": ({}, "nodes.1.imagePullPolicy", None, "Always"),
    "nodes[].env": ({}, ENV, [], [{"name": "A"}]),
    "nodes[].env[].name": ({}, ENV, [{"name": "A"}], [{"name": "B"}]),
    "nodes[].env[].valueFrom.secretKeyRef.name": variable("secretKeyRef", {"name": "b", "key": "k"}),
    "nodes[].env[].valueFrom.secretKeyRef.key": variable("secretKeyRef", {"name": "a", "key": "l"}),
    "nodes[].env[].valueFrom.configMapKeyRef.name": variable("configMapKeyRef", {"name": "b", "key": "k"}),
    "nodes[].env[].valueFrom.configMapKeyRef.key": variable("configMapKeyRef", {"name": "a", "key": "l"}),
    "nodes[].env[].value": ({}, ENV, [{"name": "A"}], [{"name": "A", "value": "b"}]),
    "nodes[].resources.limits": ({}, "nodes.1.resources.limits", {}, {"cpu": 1}),
    "nodes[].resources.requests": ({}, "nodes.1.resources.requests", {}, {"cpu": 1}),
    "nodes[].nodeSelector": ({}, "nodes.1.nodeSelector", {}, {"a": "b"}),
    "nodes[].podSpec": ({}, "nodes.1.podSpec", {}, {"priorityClassName": "robots"}),
    "nodes[].runtimeClassName": ({}, "nodes.1.runtimeClassName", None, "nvidia"),
    "nodes[].outputs": ({}, "nodes.1.outputs", [], [{"topic": "/a"}]),
    "nodes[].outputs[].topic": ({}, f"{OUTPUT}.topic", "/a", "/b"),
    "nodes[].outputs[].type": ({}, f"{OUTPUT}.type", "a/msg/A", "a/msg/B"),
    "nodes[].outputs[].rate": ({}, f"{OUTPUT}.rate", 20, 21),
    "nodes[].outputs[].deadline": ({}, f"{OUTPUT}.deadline", "150ms", "160ms"),
    "nodes[].outputs[].qos.reliability": ({}, f"{OUTPUT}.qos.reliability", "Reliable", "BestEffort"),
    "nodes[].outputs[].qos.durability": ({}, f"{OUTPUT}.qos.durability", "Volatile", "TransientLocal"),
    "nodes[].outputs[].qos.depth": ({}, f"{OUTPUT}.qos.depth", 10, 11),
    "nodes[].outputs[].mirror": ({}, f"{OUTPUT}.mirror", True, False),
    "nodes[].outputs[].while.actions": (
        {"nodes.1.actions": [FOLLOW, FOLLOW | {"name": "/b"}]},
        f"{OUTPUT}.while",
        {"actions": ["/a"]},
        {"actions": ["/b"]},
    ),
    "nodes[].outputs[].while.topic": (CARRIED, f"{OUTPUT}.while", CONDITION, CONDITION | {"topic": "/b"}),
    "nodes[].outputs[].while.within": (CARRIED, f"{OUTPUT}.while", CONDITION, CONDITION | {"within": "60ms"}),
    "nodes[].outputs[].shared": ({}, f"{OUTPUT}.shared", False, True),
    "nodes[].outputs[].frames": ({"nodes.1.outputs": [{"topic": "/tf"}]}, f"{OUTPUT}.frames", [], [FRAME]),
    "nodes[].outputs[].frames[].parent": (
        {"nodes.1.outputs": [{"topic": "/tf"}]},
        f"{OUTPUT}.frames",
        [FRAME],
        [FRAME | {"parent": "world"}],
    ),
    "nodes[].outputs[].frames[].child": (
        {"nodes.1.outputs": [{"topic": "/tf"}]},
        f"{OUTPUT}.frames",
        [FRAME],
        [FRAME | {"child": "base"}],
    ),
    "nodes[].outputs[].maxAge": ({"nodes.2.outputs": [{"topic": "/o"}]}, "nodes.2.outputs.0.maxAge", None, "1s"),
    "nodes[].services": served("services", [], [CALL]),
    "nodes[].services[].name": served("services", [CALL], [CALL | {"name": "/b"}]),
    "nodes[].services[].type": served("services", [CALL], [CALL | {"type": "a/srv/B"}]),
    "nodes[].services[].mode": served("services", [CALL], [CALL | {"mode": "Idempotent"}]),
    "nodes[].services[].timeout": served("services", [CALL], [CALL | {"timeout": "3s"}]),
    "nodes[].actions": served("actions", [], [FOLLOW]),
    "nodes[].actions[].name": served("actions", [FOLLOW], [FOLLOW | {"name": "/b"}]),
    "nodes[].actions[].type": served("actions", [FOLLOW], [FOLLOW | {"type": "a/action/B"}]),
    "nodes[].actions[].onSwitch": served("actions", [FOLLOW], [FOLLOW | {"onSwitch": "Abort"}]),
    "nodes[].actions[].accept": served("actions", [FOLLOW], [FOLLOW | {"accept": "Holder"}]),
    "nodes[].actions[].holdFor": served("actions", [HELD], [HELD | {"holdFor": "3s"}]),
    "nodes[].actions[].timeout": served("actions", [FOLLOW], [FOLLOW | {"timeout": "3s"}]),
    "nodes[].actions[].resultTimeout": served("actions", [FOLLOW], [FOLLOW | {"resultTimeout": "3s"}]),
    "nodes[].actions[].mirror": served("actions", [FOLLOW], [FOLLOW | {"mirror": True}]),
    "nodes[].uses.services": served("uses", {}, {"services": [CALL]}),
    "nodes[].uses.services[].name": served("uses", {"services": [CALL]}, {"services": [CALL | {"name": "/b"}]}),
    "nodes[].uses.services[].type": served("uses", {"services": [CALL]}, {"services": [CALL | {"type": "a/srv/B"}]}),
    "nodes[].uses.services[].timeout": served("uses", {"services": [CALL]}, {"services": [CALL | {"timeout": "3s"}]}),
    "nodes[].uses.actions": served("uses", {}, {"actions": [GOAL]}),
    "nodes[].uses.actions[].name": served("uses", {"actions": [GOAL]}, {"actions": [GOAL | {"name": "/b"}]}),
    "nodes[].uses.actions[].type": served("uses", {"actions": [GOAL]}, {"actions": [GOAL | {"type": "a/action/B"}]}),
    "nodes[].uses.actions[].cancelAfter": served(
        "uses", {"actions": [GOAL]}, {"actions": [GOAL | {"cancelAfter": "0s"}]}
    ),
    "nodes[].uses.actions[].timeout": served("uses", {"actions": [GOAL]}, {"actions": [GOAL | {"timeout": "3s"}]}),
    "nodes[].state": served("state", [], [{"snapshot": True}]),
    "nodes[].state[].topic": served("state", [KEPT], [KEPT | {"topic": "/c"}]),
    "nodes[].state[].restore": served("state", [KEPT], [KEPT | {"restore": "/c"}]),
    "nodes[].state[].parameters.nodes": served("state", [{"parameters": {}}], [{"parameters": {"nodes": ["a"]}}]),
    "nodes[].state[].parameters.except": served("state", [{"parameters": {}}], [{"parameters": {"except": ["a"]}}]),
    "nodes[].state[].snapshot": served("state", [], [{"snapshot": True}]),
    "nodes[].state[].maxAge": served("state", [{"snapshot": True}], [{"snapshot": True, "maxAge": "1s"}]),
    "nodes[].state[].maxSize": served("state", [{"snapshot": True}], [{"snapshot": True, "maxSize": "2Mi"}]),
    "topics.toCloud[].minRate": ({}, f"{SCAN}.minRate", None, 5),
    "topics.toCloud[].priority": ({}, f"{SCAN}.priority", "Normal", "High"),
    "topics.toCloud[].latest": ({}, f"{SCAN}.latest", False, True),
    "switching.prepareDeadline": ({}, "switching.prepareDeadline", None, "5s"),
    "switching.cancelDeadline": ({}, "switching.cancelDeadline", "2s", "3s"),
    "switching.settleFor": ({}, "switching.settleFor", "10s", "3s"),
    "switching.maxMessageSize": ({}, "switching.maxMessageSize", "8Mi", "1Mi"),
    "switching.silent": ({}, "switching.silent", [], ["a/**"]),
    "switching.prefer": ({}, "switching.prefer", "Cloud", "Robot"),
    "switching.profile": ({"switching": {}}, "switching.profile", "Balanced", "Patient"),
    "switching.heartbeatPeriod": ({}, "switching.heartbeatPeriod", "20ms", "21ms"),
    "switching.lossTimeout": ({}, "switching.lossTimeout", "90ms", "91ms"),
    "switching.lease": ({}, "switching.lease", "250ms", "251ms"),
    "switching.maxCommandAge": ({}, "switching.maxCommandAge", "150ms", "151ms"),
    "switching.latency.robotPeriod": ({}, "switching.latency.robotPeriod", "50ms", "51ms"),
    "switching.latency.cloudPeriod": ({}, "switching.latency.cloudPeriod", "20ms", "21ms"),
    "switching.latency.tolerance": ({}, "switching.latency.tolerance", "30ms", "31ms"),
    "switching.minDwell": ({}, "switching.minDwell", "0s", "1s"),
    "switching.mode": ({}, "switching.mode", "Auto", "Observe"),
    "switching.pin": ({}, "switching.pin", "Auto", "Robot"),
    "switching.maxClockOffset": ({}, "switching.maxClockOffset", "20ms", "21ms"),
    "switching.activationDeadline": ({}, "switching.activationDeadline", "250ms", "251ms"),
    "switching.strict": ({}, "switching.strict", False, True),
    "switching.holdDown.initial": ({}, "switching.holdDown.initial", "1s", "2s"),
    "switching.holdDown.max": ({}, "switching.holdDown.max", "30s", "31s"),
    "switching.holdDown.flapWindow": ({}, "switching.holdDown.flapWindow", "5s", "6s"),
    "replicas": ({}, "replicas", 1, 0),
}
# Decided when time passes, so nothing that is rendered shows it: tests/unit/reconcile judges it.
BY_TIME = {"scale.idleTimeout"}


# Refused until it is built, so nothing that is rendered shows it: the words' own tests judge it.
_REFUSED = tuple(
    f"{word.path}.{word.field}".removeprefix("spec.")
    for key, word in not_yet.NOT_YET.items()
    if key not in ("plain", "Race", "Hold", "cloudNames")  # one value of a field that is built
)


def refused(field: str) -> bool:
    """Whether the field, or the block around it, is a word that is not built yet."""
    goes_with = {"nodes[].actions[].holdFor": "Hold", "nodes[].state[].restore": "stateTopic"}
    if field in goes_with:
        return not not_yet.built(goes_with[field])
    return any(field == word or field.startswith((f"{word}.", f"{word}[]")) for word in _REFUSED)


def outcome(besides: dict[str, Any], path: str, value: Any) -> str:
    """All that the cluster and the robot get, as text in which numbers keep their types."""
    offload = parse_object(resource({**copy.deepcopy(besides), path: value}), "test.yaml")
    known = facts(endpoints=EVERY_ENDPOINT, user_configs=CONFIGS)
    parent = Parent(offload, known)
    files = bundle(parent, SECRETS if transport.needs_certificates(offload.spec) else None)
    asked = certificate(offload)
    images = decide(parent, Before({}, (), frozenset(), BEGINNING), "").manifests
    return json.dumps([children(parent), images, {name: text.decode() for name, text in files.items()}, asked])


def certificate(offload: RobotOffload) -> Any:
    """What cert-manager is asked for, where an issuer is named."""
    issued = offload.spec.transport.certificates.issuer_ref is not None
    return issuer.certificates(Parent(offload, facts())) if issued else None


def test_the_list_here_is_the_list_of_the_fields() -> None:
    leaves = {
        path.removeprefix("spec.")
        for path, _, kind, _ in FIELDS
        if path.startswith("spec.") and not (isinstance(kind, type) and issubclass(kind, Model))
    }
    assert {leaf for leaf in leaves if not refused(leaf)} == {it for it in CHANGES if not refused(it)} | BY_TIME


@pytest.mark.parametrize("field", [field for field in CHANGES if not refused(field)])
def test_a_changed_field_changes_what_comes_out(field: str) -> None:
    besides, path, first, second = CHANGES[field]
    assert outcome(besides, path, first) != outcome(besides, path, second)
