"""For every rule of the CRD: what breaks it, and what just keeps it. Checked by the models and by a real API server."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from robot_offload.api.v1alpha1.rules import not_yet
from tests.unit.specs import changed, sample


@dataclass(frozen=True)
class Example:
    """A change of the sample specification.

    Attributes:
        rule: path and reason of the rule that it is about.
        path: the changed field, as in `spec.nodes.1.name`.
        value: its new value; `...` removes it.
    """

    rule: tuple[str, str]
    path: str
    value: Any

    @property
    def name(self) -> str:
        return f"{self.rule[1]}-{self.path.removeprefix('spec.')}-{self.value}"[:70]


def example_values(path: str, value: Any) -> dict[str, Any]:
    """The sample with that change; both sides in one domain, which some transports need, unless it is about that."""
    values = changed(path, value)
    if path != "spec" and not path.startswith("spec.cloud"):
        del values["spec"]["cloud"]["domainID"]
    return values


def _of(path: str, reason: str, *changes: tuple[str, Any]) -> tuple[Example, ...]:
    return tuple(Example((path, reason), changed, value) for changed, value in changes)


_INPUTS = "spec.topics.toCloud[]"
_TRANSPORT, _EXPOSE, _SWITCHING = "spec.transport", "spec.transport.expose", "spec.switching"
_LATENCY = "spec.switching.latency"
_TOLERATION = "spec.cloud.tolerations[]"
_WRONG_RESOURCES: tuple[tuple[str, Any], ...] = (
    ("OutOfRange", {"limits": {"cpu": 1}, "requests": {"cpu": "1001m"}}),
    ("Invalid", {"limits": {"nvidia.com/gpu": "1500m"}}),
    ("Required", {"requests": {"nvidia.com/gpu": 1}}),
)
_PEERS = {"type": "StaticPeers", "staticPeers": {"robot": ["10.0.0.1"]}}
_SPEC: dict[str, Any] = sample()["spec"]
_ENTRY = {"name": "a", "key": "b"}
_FROM_SECRET: dict[str, Any] = {"secretKeyRef": _ENTRY}
_CONTROLLER, _OUTPUT = "spec.nodes.1", "spec.nodes.1.outputs.0"

BUILD = {
    "git": {"url": "https://git.example/robot.git", "ref": "v1", "paths": ["src/planner"]},
    "package": "planner",
    "executable": "planner_server",
}
"""The least that a build block says."""
_BUILT = {key: value for key, value in _SPEC["nodes"][2].items() if key != "image"} | {"build": BUILD}
_REGISTRY = {"registry": {"repository": "registry.example/robots"}}

_ACTION, _STATE, _WHILE = f"{_CONTROLLER}.actions", f"{_CONTROLLER}.state", f"{_OUTPUT}.while"
PLAN = {"name": "/make_plan", "type": "nav_msgs/srv/GetPlan"}
"""A service, as it is declared by the node that offers it or calls it."""
FOLLOW = {"name": "/follow_path", "type": "nav2_msgs/action/FollowPath"}
RESENT = FOLLOW | {"onSwitch": "Resend"}
"""An action of a duplicated node."""
TF = {"topic": "/tf", "frames": [{"parent": "map", "child": "odom"}]}
_HOT = {key: value for key, value in _SPEC["nodes"][1].items() if key != "standby"}
_PLANNER = _SPEC["nodes"][2]
POOL = _PLANNER | {"lifecycle": False, "services": [PLAN], "replicas": 2}
"""A node whose calls several pods share."""

_SERVED: tuple[Example, ...] = (
    *_of(
        "spec.nodes[].actions[]",
        "Contradiction",
        (_ACTION, [RESENT | {"holdFor": "5s"}]),
        ("spec.nodes.2.actions", [FOLLOW | {"holdFor": "5s"}]),
    ),
    *_of("spec.nodes[].actions[]", "TwiceNotAllowed", (_ACTION, [FOLLOW | {"onSwitch": "Abort", "mirror": True}])),
    *_of(
        "spec.nodes[]",
        "NoMirror",
        (_CONTROLLER, {**_HOT, "actions": [RESENT | {"mirror": True}]}),
        (_CONTROLLER, {**_HOT, "standby": {"robot": "Hot"}, "actions": [RESENT | {"mirror": True}],
                       "uses": {"services": [PLAN]}}),
        ("spec.nodes.2.actions", [RESENT | {"mirror": True}]),
    ),
    *_of(
        "spec.nodes[]",
        "ServedByItself",
        ("spec.nodes.0.services", [PLAN]),
        ("spec.nodes.0.actions", [FOLLOW]),
        ("spec.nodes.0.uses", {"actions": [FOLLOW]}),
    ),
    *_of("spec.nodes[]", "OneReplica", *(("spec.nodes.2.services", [PLAN | {"mode": it}]) for it in ("Both", "Race"))),
    *_of("spec.nodes[]", "OneActs", (f"{_CONTROLLER}.replicas", 2), ("spec.nodes.0.replicas", 1)),
    *_of("spec.nodes[]", "OnePublisher", ("spec.nodes.2", POOL | {"outputs": [{"topic": "/plan"}]})),
    *_of("spec.nodes[]", "GoalsNotShared", ("spec.nodes.2", POOL | {"actions": [FOLLOW]})),
    *_of("spec.nodes[]", "OneLifecycle", ("spec.nodes.2", POOL | {"lifecycle": True})),
    *_of("spec.nodes[]", "NothingShared", ("spec.nodes.2", POOL | {"services": []})),
    *_of("spec.nodes[]", "NoProgram", ("spec.nodes.2", {key: it for key, it in POOL.items() if key != "run"})),
    *_of("spec.nodes[]", "TooLong", ("spec.nodes.2", POOL | {"services": [PLAN | {"name": f"/{'a' * 160}"}]})),
    *_of("spec.nodes[]", "OutOfRange", ("spec.nodes.2", POOL | {"maxReplicas": 1}), ("spec.nodes.2.maxReplicas", 2)),
    *_of("spec.nodes[]", "NoReplica", ("spec.nodes.2.state", [{"snapshot": True}]),
         ("spec.nodes.2.actions", [RESENT]),
         ("spec.nodes.0.state", [{"parameters": {}}])),
    *_of(
        "spec.nodes[].state[]",
        "OneKind",
        (_STATE, [{}]),
        (_STATE, [{"snapshot": False}]),
        (_STATE, [{"snapshot": True, "parameters": {}}]),
        (_STATE, [{"topic": "/a", "restore": "/b", "snapshot": True}]),
    ),
    *_of(
        "spec.nodes[].state[]",
        "Required",
        (_STATE, [{"topic": "/amcl_pose"}]),
        (_STATE, [{"restore": "/initialpose"}]),
        (_STATE, [{"topic": "/a", "restore": "/a"}]),
    ),
    *_of(
        "spec.nodes[].state[]",
        "Contradiction",
        (_STATE, [{"parameters": {}, "maxAge": "1s"}]),
        (_STATE, [{"topic": "/a", "restore": "/b", "maxSize": "1Mi"}]),
    ),
    *_of(
        "spec.nodes[].outputs[].while",
        "OneKind",
        (_WHILE, {}),
        (_WHILE, {"actions": []}),
        (_WHILE, {"actions": ["/spin"], "topic": "/scan", "within": "1s"}),
    ),
    *_of("spec.nodes[].outputs[].while", "Required", (_WHILE, {"topic": "/scan"}),
         (_WHILE, {"actions": ["/spin"], "within": "1s"})),
    *_of("spec.nodes[].outputs[]", "NoRate", (_OUTPUT, {"topic": "/a", "while": {"topic": "/scan", "within": "1s"}})),
    *_of("spec.nodes[].outputs[]", "NoTransforms", (_OUTPUT, TF | {"topic": "/cmd_vel"})),
    *_of("spec.nodes[].outputs[].frames[]", "Contradiction",
         (_OUTPUT, TF | {"frames": [{"parent": "map", "child": "map"}]})),
    *_of("spec.nodes[]", "NotOfCloud", (f"{_OUTPUT}.maxAge", "1s"),
         ("spec.nodes.0.outputs", [{"topic": "/a", "maxAge": "1s"}])),
    *_of(
        "spec.nodes[]",
        "AlwaysHot",
        (f"{_CONTROLLER}.lifecycle", False),
        (_CONTROLLER, {**_HOT, "lifecycle": False, "standby": {"robot": "Hot"}}),
    ),
    *_of("spec.nodes[]", "NothingDeclared", (_CONTROLLER, {**_HOT, "lifecycle": False, "outputs": []})),
    *_of(_INPUTS, "OutOfRange", ("spec.topics.toCloud.0.minRate", 21), ("spec.topics.toCloud.0.minRate", 3)),
    *_of(_INPUTS, "Contradiction", ("spec.topics.toCloud.0", {"name": "/scan", "latched": True, "latest": True})),
    *_of(_SWITCHING, "TooShort", ("spec.switching.prepareDeadline", "249ms")),
)  # fmt: skip
"""About services, actions and state."""

BROKEN: tuple[Example, ...] = (
    *_SERVED,
    *(Example((word.path, not_yet.REASON), *word.example) for word in not_yet.NOT_YET.values()),
    *_of(
        _TRANSPORT,
        "WrongBlock",
        (_TRANSPORT, {"type": "DDSRouter", "zenoh": {}}),
        (_TRANSPORT, {"ddsRouter": {}}),
        (_TRANSPORT, {"type": "Zenoh", "discoveryServer": {}}),
        (_TRANSPORT, {"type": "Zenoh", "staticPeers": {"robot": ["10.0.0.1"]}}),
        (_TRANSPORT, {**_PEERS, "expose": {}}),
        (_TRANSPORT, {"type": "DiscoveryServer", "certificates": {}}),
    ),
    *_of(
        _TRANSPORT,
        "NoPeers",
        (_TRANSPORT, {"type": "StaticPeers"}),
        (_TRANSPORT, {"type": "StaticPeers", "staticPeers": {}}),
        (_TRANSPORT, {"type": "StaticPeers", "staticPeers": {"robot": [], "cloud": ["10.0.0.1"]}}),
    ),
    *_of(
        "spec.transport.zenoh",
        "ReservedPort",
        ("spec.transport.zenoh", {"pulsePort": 8080}),
        ("spec.transport.zenoh", {"dataPort": 8080}),
    ),
    *_of(
        "spec",
        "OutOfRange",
        (_TRANSPORT, {"type": "DiscoveryServer", "expose": {"nodePorts": {"discovery": 65535}}}),
    ),
    *(
        example
        for reason, resources in _WRONG_RESOURCES
        for example in (
            *_of("spec.nodes[].resources", reason, (f"{_CONTROLLER}.resources", resources)),
            *_of(
                "spec.nodes[].build.resources",
                reason,
                ("spec.nodes.2", {**_BUILT, "build": {**BUILD, "resources": resources}}),
            ),
        )
    ),
    *_of(
        "spec.nodes[].build.git",
        "LocalSource",
        ("spec.nodes.2", {**_BUILT, "build": {**BUILD, "git": {"url": "file:///src"}}}),
    ),
    *_of("spec.transport.zenoh", "SamePort", ("spec.transport.zenoh", {"pulsePort": 7448})),
    *_of(
        _EXPOSE,
        "WrongExposure",
        (_EXPOSE, {"type": "NodePort", "address": "192.0.2.1"}),
        (_EXPOSE, {"type": "ClusterIP", "loadBalancerClass": "example.com/internal"}),
        (_EXPOSE, {"type": "NodePort", "sourceRanges": ["198.51.100.0/24"]}),
        (_EXPOSE, {"type": "ClusterIP", "nodePorts": {"pulse": 30001}}),
    ),
    *_of(
        "spec.transport.certificates",
        "TooLong",
        ("spec.transport.certificates", {"duration": "24h", "renewBefore": "24h"}),
        ("spec.transport.certificates", {"duration": "48h"}),
    ),
    *_of(
        "spec",
        "DomainsDiffer",
        ("spec", {**_SPEC, "transport": {"type": "DiscoveryServer"}, "cloud": {"domainID": 43}}),
        ("spec", {**_SPEC, "transport": _PEERS, "cloud": {"domainID": 0}}),
    ),
    *_of(
        "spec",
        "CloudRmw",
        ("spec.robot.rmw", "rmw_cyclonedds_cpp"),
        ("spec.cloud.rmw", "rmw_zenoh_cpp"),
    ),
    *_of(
        _TOLERATION,
        "Contradiction",
        ("spec.cloud.tolerations", [{"key": "a", "operator": "Exists", "value": "b"}]),
        ("spec.cloud.tolerations", [{"key": "a", "value": "b", "tolerationSeconds": 3}]),
        ("spec.cloud.tolerations", [{"key": "a", "value": "b", "effect": "NoSchedule", "tolerationSeconds": 3}]),
    ),
    *_of(_TOLERATION, "Required", ("spec.cloud.tolerations", [{"value": "b"}])),
    *_of(
        "spec.topics.toCloud[]",
        "Contradiction",
        ("spec.topics.toCloud.2.qos.durability", "Volatile"),
    ),
    *_of("spec.nodes[]", "CoreInCloud", ("spec.nodes.2.core", True)),
    *_of("spec.nodes[]", "NoImage", (f"{_CONTROLLER}.image", ...), ("spec.nodes.2.image", None)),
    *_of("spec.nodes[]", "TwoImages", (f"{_CONTROLLER}.build", BUILD)),
    *_of(
        "spec.nodes[].build",
        "OneProgram",
        ("spec.nodes.2", {**_BUILT, "build": {**BUILD, "launch": "all.launch.py"}}),
        ("spec.nodes.2", {**_BUILT, "build": {**BUILD, "executable": None}}),
    ),
    *_of(
        "spec.nodes[].build",
        "NoSecret",
        ("spec.nodes.2", {**_BUILT, "build": {**BUILD, "git": {"url": "git@git.example:robot.git"}}}),
        ("spec.nodes.2", {**_BUILT, "build": {**BUILD, "git": {"url": "ssh://git@git.example/robot.git"}}}),
    ),
    *_of("spec", "NoRegistry", ("spec.nodes.2", _BUILT)),
    *_of("spec.nodes[]", "NoProgram", ("spec.nodes.2.run", ...), ("spec.nodes.2.run", None)),
    *_of("spec.nodes[]", "RemapsOutput", (f"{_CONTROLLER}.run.remap", {"/cmd_vel": "/other"})),
    *_of(
        "spec.nodes[].run",
        "TwoPrograms",
        (f"{_CONTROLLER}.run.package", "nav2"),
        (f"{_CONTROLLER}.run.executable", "controller"),
    ),
    *_of(
        "spec.nodes[].run",
        "NoProgram",
        (f"{_CONTROLLER}.run.command", ...),
        (f"{_CONTROLLER}.run.command", []),
        ("spec.nodes.2.run.executable", ...),
        ("spec.nodes.2.run.package", None),
    ),
    *_of("spec.nodes[].outputs[]", "NoRate", (f"{_OUTPUT}.rate", ...), (f"{_OUTPUT}.rate", None)),
    *_of("spec.nodes[].outputs[]", "TooShort", (f"{_OUTPUT}.deadline", "50ms"), (f"{_OUTPUT}.rate", 0.05)),
    *_of(
        "spec.nodes[].env[]",
        "ReservedVariable",
        (f"{_CONTROLLER}.env", [{"name": "ROS_DOMAIN_ID", "value": "3"}]),
        (f"{_CONTROLLER}.env", [{"name": "FINE"}, {"name": "ROS_DISCOVERY_SERVER"}]),
    ),
    *_of(
        "spec.nodes[].env[]",
        "TwoValues",
        (f"{_CONTROLLER}.env", [{"name": "A", "value": "b", "valueFrom": _FROM_SECRET}]),
    ),
    *_of(
        "spec.nodes[].env[].valueFrom",
        "OneSource",
        (f"{_CONTROLLER}.env", [{"name": "A", "valueFrom": {}}]),
        (f"{_CONTROLLER}.env", [{"name": "A", "valueFrom": _FROM_SECRET | {"configMapKeyRef": _ENTRY}}]),
    ),
    *_of(
        _SWITCHING,
        "TooShort",
        ("spec.switching.lossTimeout", "40ms"),
        ("spec.switching.lease", "189ms"),
        ("spec.switching.maxCommandAge", "80ms"),
        (f"{_LATENCY}.tolerance", "101ms"),
    ),
    *_of(
        _SWITCHING,
        "MultipleOfPeriod",
        ("spec.switching.lossTimeout", "80ms"),
        ("spec.switching", {"heartbeatPeriod": "300ms", "lossTimeout": "1200ms", "lease": "3s", "maxCommandAge": "1s"}),
        ("spec.switching", {"heartbeatPeriod": "1s", "lossTimeout": "3s", "lease": "9s", "maxCommandAge": "2s"}),
    ),
    *_of(_LATENCY, "NeverInCloud", (f"{_LATENCY}.cloudPeriod", "80ms"), (f"{_LATENCY}.cloudPeriod", "10s")),
    *_of(
        "spec.switching.holdDown",
        "OutOfRange",
        ("spec.switching.holdDown", {"initial": "31s"}),
        ("spec.switching.holdDown.max", "500ms"),
    ),
)
"""Each is refused for the reason that it names."""

_KEPT_WORDS: tuple[tuple[str, str, Any], ...] = (
    ("services", f"{_CONTROLLER}.services", [PLAN, {**PLAN, "name": "/clear", "mode": "Both", "timeout": "10ms"}]),
    ("cloudNames", "spec.nodes.2.services", [PLAN | {"mode": "Idempotent"}]),
    ("Hold", _ACTION, [RESENT, {**FOLLOW, "name": "/spin", "onSwitch": "Hold", "holdFor": "1s"}]),
    ("actions", _ACTION, [RESENT, {**FOLLOW, "name": "/spin", "onSwitch": "Abort"}]),
    ("actions", _ACTION, [RESENT | {"accept": "Holder"}]),
    ("cloudNames", "spec.nodes.2.actions", [FOLLOW]),
    ("mirror", _CONTROLLER, {**_HOT, "standby": {"robot": "Hot"}, "actions": [RESENT | {"mirror": True}]}),
    ("uses", f"{_CONTROLLER}.uses", {"services": [PLAN], "actions": [FOLLOW | {"cancelAfter": "0s"}]}),
    ("uses", "spec.nodes.2.uses", {"actions": [FOLLOW]}),
    ("state", _STATE, [{"snapshot": True, "maxAge": "1s", "maxSize": "16Mi"}]),
    ("stateTopic", _STATE, [{"topic": "/amcl_pose", "restore": "/initialpose"}]),
    ("stateParameters", _STATE, [{"parameters": {"nodes": ["a", "/b/c"], "except": ["use_gpu"]}}]),
    ("while", _WHILE, {"topic": "/scan", "within": "100ms"}),
    ("shared", f"{_OUTPUT}.shared", True),
    ("frames", _OUTPUT, TF),
    ("maxAge", "spec.nodes.2.outputs", [{"topic": "/objects", "maxAge": "500ms"}]),
    ("plain", _CONTROLLER, {**_HOT, "lifecycle": False}),
    ("plain", _CONTROLLER, {**_HOT, "lifecycle": False, "standby": {"robot": "Hot", "cloud": "Hot"}}),
    ("minRate", "spec.topics.toCloud.0.minRate", 20),
    ("priority", "spec.topics.toCloud.0.priority", "Low"),
    ("latest", "spec.topics.toCloud.0.latest", True),
    ("prepareDeadline", "spec.switching.prepareDeadline", "250ms"),
    ("cancelDeadline", "spec.switching.cancelDeadline", "10ms"),
    ("settleFor", "spec.switching.settleFor", "0s"),
    ("maxMessageSize", "spec.switching.maxMessageSize", "16Mi"),
    ("silent", "spec.switching.silent", ["local_costmap/**", "/a/b", "c/*", "**"]),
)  # fmt: skip
WORDS: tuple[tuple[str, Any], ...] = tuple((path, value) for _, path, value in _KEPT_WORDS)
"""What is right once its word is built."""

KEPT: tuple[tuple[str, Any], ...] = (
    *((path, value) for word, path, value in _KEPT_WORDS if not_yet.built(word)),
    (f"{_CONTROLLER}.uses", {}),
    (f"{_CONTROLLER}.services", []),
    (f"{_CONTROLLER}.state", []),
    ("spec.switching.cancelDeadline", "2000ms"),
    ("spec.switching.maxMessageSize", "8192Ki"),
    (_TRANSPORT, ...),
    (_TRANSPORT, {}),
    (_TRANSPORT, {"type": "DDSRouter"}),
    (_TRANSPORT, {"type": "DDSRouter", "ddsRouter": {"domainID": None}, "expose": {}, "certificates": {}}),
    (_TRANSPORT, {"type": "DiscoveryServer", "discoveryServer": {}, "expose": {"type": "ClusterIP"}}),
    (_TRANSPORT, _PEERS),
    ("spec", {**_SPEC, "cloud": _REGISTRY, "nodes": [_BUILT]}),
    ("spec", {**_SPEC, "nodes": [{"name": "a", "placement": "Robot", "build": BUILD}]}),
    (
        "spec",
        {
            **_SPEC,
            "cloud": _REGISTRY,
            "nodes": [
                _BUILT | {"build": {**BUILD, "git": {"url": "git@git.example:a.git"}, "gitSecret": {"name": "key"}}}
            ],
        },
    ),
    (_EXPOSE, {"address": "192.0.2.1", "loadBalancerClass": "example.com/internal", "nodePorts": {"pulse": 30001}}),
    (_EXPOSE, {"sourceRanges": ["198.51.100.0/24", "2001:db8::/32", "192.0.2.7/32"]}),
    (_EXPOSE, {"type": "ClusterIP", "address": None, "loadBalancerClass": None, "nodePorts": None}),
    ("spec.transport.certificates", {"duration": "24h", "renewBefore": "23h"}),
    ("spec.transport.certificates", {"issuerRef": {"name": "corporate"}}),
    ("spec.cloud", ...),
    ("spec", {**_SPEC, "transport": {"type": "DiscoveryServer"}, "cloud": {"domainID": 42}}),
    ("spec.cloud", {"rmw": None, "runAsUser": None, "domainID": None}),
    ("spec.cloud.rmw", "rmw_fastrtps_dynamic_cpp"),
    ("spec.cloud.tolerations", [{"operator": "Exists"}, {"key": "a", "value": "b", "effect": None}]),
    ("spec.cloud.tolerations", [{"operator": "Exists", "value": "", "effect": "NoExecute", "tolerationSeconds": 3}]),
    ("spec.topics.toCloud.2.qos.durability", None),
    ("spec.topics.toCloud.2.qos", None),
    (f"{_CONTROLLER}.run.remap", {"/cmd_vel": "/cmd_vel"}),
    (f"{_CONTROLLER}.run.package", None),
    (f"{_CONTROLLER}.resources", {"limits": {"nvidia.com/gpu": 1, "memory": "1Gi"}, "requests": {"cpu": "500m"}}),
    (f"{_CONTROLLER}.env", [{"name": "OMP_NUM_THREADS", "value": "2"}]),
    (f"{_CONTROLLER}.env", [{"name": "TOKEN", "valueFrom": _FROM_SECRET}]),
    (f"{_OUTPUT}.deadline", "51ms"),
    (f"{_OUTPUT}.deadline", None),
    ("spec.switching", ...),
    ("spec.switching.lossTimeout", "41ms"),
    ("spec.switching.lease", "190ms"),
    ("spec.switching.maxCommandAge", "81ms"),
    (f"{_LATENCY}.cloudPeriod", "79ms"),
    ("spec.switching.holdDown", {"initial": "30s"}),
    ("spec.scale", {"idleTimeout": "0s"}),
    ("spec.nodes.2", POOL),
    ("spec.nodes.2", POOL | {"replicas": 1, "maxReplicas": 32}),
    ("spec.nodes.2", POOL | {"services": [PLAN | {"name": f"/{'a' * 159}"}]}),
    ("spec.replicas", 0),
)
"""Changes after which the sample is still right."""
