"""Specifications that look right and would break something: the cluster's objects, another tenant, or the switch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from tests.contract.rule_examples import BUILD, example_values
from tests.unit.specs import sample

_CONTROLLER = "spec.nodes.1"
_EXPOSE = "spec.transport.expose"
_SPEC: dict[str, Any] = sample()["spec"]
_DIGEST = "sha256:" + "0123456789abcdef" * 4


@dataclass(frozen=True)
class Hostile:
    """A change of the sample that must be refused.

    Attributes:
        name: what it tries.
        path: the changed field.
        value: its new value.
        advice: what the refusal says.
        by_server: whether the API server refuses the object as well, by a pattern or a rule of the CRD.
    """

    name: str
    path: str
    value: Any
    advice: str
    by_server: bool = True

    @property
    def values(self) -> dict[str, Any]:
        return example_values(self.path, self.value)


def _built(**changes: Any) -> tuple[str, Any]:
    """A node that is built, with these changes of its build block."""
    node = {key: value for key, value in _SPEC["nodes"][2].items() if key != "image"} | {"build": {**BUILD, **changes}}
    registry = {"registry": {"repository": "registry.example/robots"}}
    return "spec", {**_SPEC, "cloud": registry, "nodes": [node]}


def _git(url: str) -> tuple[str, Any]:
    return _built(git={"url": url}, gitSecret={"name": "key"})


def _resources(**given: Any) -> tuple[str, Any]:
    return f"{_CONTROLLER}.resources", given


def _registry(repository: str) -> tuple[str, Any]:
    return "spec.cloud.registry", {"repository": repository}


HOSTILE: tuple[Hostile, ...] = (
    Hostile("pod-host", "spec.cloud.podSpec", {"hostNetwork": True}, "hostNetwork is not a field", by_server=False),
    Hostile(
        "pod-host-path",
        f"{_CONTROLLER}.podSpec",
        {"volumes": [{"name": "etc", "hostPath": {"path": "/etc"}}]},
        "hostPath is not a field",
        by_server=False,
    ),
    Hostile("expose-host-long-label", _EXPOSE, {"host": "a" * 64 + ".example"}, "at most 63"),
    Hostile("expose-host-zero", _EXPOSE, {"host": "0.0.0.0"}, "IP address of one machine"),
    Hostile("expose-host-no-address", _EXPOSE, {"host": "999.1.1.1"}, "IP address of one machine"),
    Hostile("expose-address-bad", _EXPOSE, {"address": "999.999.999.999"}, "IP address of one machine"),
    Hostile("expose-address-colons", _EXPOSE, {"address": ":::::"}, "IP address of one machine"),
    Hostile("expose-address-multicast", _EXPOSE, {"address": "239.1.1.1"}, "IP address of one machine"),
    Hostile("expose-address-mapped", _EXPOSE, {"address": "::ffff:192.0.2.1"}, "IP address of one machine"),
    Hostile("expose-range-no-length", _EXPOSE, {"sourceRanges": ["198.51.100.0"]}, "begins with its first one"),
    Hostile("expose-range-inside", _EXPOSE, {"sourceRanges": ["198.51.100.7/24"]}, "begins with its first one"),
    Hostile("expose-range-long", _EXPOSE, {"sourceRanges": ["198.51.100.0/33"]}, "begins with its first one"),
    Hostile("expose-class-long-name", _EXPOSE, {"loadBalancerClass": "a/" + "b" * 64}, "name of a label"),
    Hostile("expose-annotation-own", _EXPOSE, {"annotations": {"robotoffload.dev/a": "x"}}, "operator itself", False),
    Hostile("expose-annotation-long", _EXPOSE, {"annotations": {"a" * 64: "x"}}, "name of a label", False),
    Hostile("peer-zero", "spec.transport", {"type": "StaticPeers", "staticPeers": {"robot": ["0.0.0.0"]}}, "machine"),
    Hostile("peer-dots", "spec.transport", {"type": "StaticPeers", "staticPeers": {"robot": ["a..b"]}}, "an address"),
    Hostile("peer-bad", "spec.transport", {"type": "StaticPeers", "staticPeers": {"robot": ["1.2.3"]}}, "IP address"),
    Hostile("nodeports-overlap", "spec.transport",
            {"type": "DiscoveryServer", "expose": {"type": "NodePort", "nodePorts": {"discovery": 65535}}},
            "write a lower port"),
    Hostile("nodeports-meet", _EXPOSE, {"nodePorts": {"pulse": 30001, "data": 30001}}, "one purpose", False),
    Hostile("reporter-port", "spec.transport.zenoh.pulsePort", 8080, "is taken by the reporter"),
    Hostile("registry-port", *_registry("registry.example:99999/a"), "host:port/path"),
    Hostile("registry-port-zero", *_registry("registry.example:0/a"), "host:port/path"),
    Hostile("base-image-port", *_built(base="registry.example:99999/a"), "write registry/name:tag"),
    Hostile("base-image-dots", *_built(base="registry.example/a..b"), "write registry/name:tag"),
    Hostile("image-bad-digest", f"{_CONTROLLER}.image", "a@sha256:1", "is not an image"),
    Hostile("image-dots", f"{_CONTROLLER}.image", "a..b/c", "is not an image"),
    Hostile("image-many-at", f"{_CONTROLLER}.image", f"a@{_DIGEST}@{_DIGEST}", "is not an image"),
    Hostile("image-scheme", f"{_CONTROLLER}.image", "https://registry.example/a", "is not an image"),
    Hostile("image-port", f"{_CONTROLLER}.image", "registry.example:70000/a", "is not an image"),
    Hostile("image-capitals", f"{_CONTROLLER}.image", "registry.example/Nav2", "is not an image"),
    Hostile("request-over-limit", *_resources(limits={"cpu": 1}, requests={"cpu": "1500m"}), "more than its limit"),
    Hostile("request-over-limit-units", *_resources(limits={"memory": "1G"}, requests={"memory": "1Gi"}), "its limit"),
    Hostile("gpu-fraction", *_resources(limits={"nvidia.com/gpu": "500m"}), "come whole"),
    Hostile("gpu-request-only", *_resources(requests={"nvidia.com/gpu": 1}), "the same number under limits"),
    Hostile("gpu-shared", *_resources(limits={"nvidia.com/gpu": 2}, requests={"nvidia.com/gpu": 1}), "same number"),
    Hostile("huge-pages-request", *_resources(requests={"hugepages-2Mi": "4Mi"}), "the same number under limits"),
    Hostile("quantity-negative", *_resources(limits={"cpu": -1}), "is not a quantity"),
    Hostile("unknown-resource", *_resources(limits={"gpu": 1}), "not a resource of a container", False),
    Hostile("build-request-over-limit", *_built(resources={"limits": {"cpu": 1}, "requests": {"cpu": 2}}), "its limit"),
    Hostile("selector-key-long-name", "spec.cloud.nodeSelector", {"a" * 64: "b"}, "name of a label", False),
    Hostile("selector-key-brackets", "spec.cloud.nodeSelector", {"a b": "b"}, "name of a label", False),
    Hostile("toleration-key-long", "spec.cloud.tolerations", [{"key": "a" * 64, "operator": "Exists"}], "of a label"),
    Hostile("label-bad", "metadata.labels", {"a": "b c"}, "a label's value"),
    Hostile("parameters-from-dotdot", f"{_CONTROLLER}.run.parametersFrom",
            {"configMapKeyRef": {"name": "nav", "key": "..nav"}}, "a key of a ConfigMap"),
    Hostile("remap-node-name", f"{_CONTROLLER}.run.remap", {"__node": "other"}, "two underscores", False),
    Hostile("remap-namespace", f"{_CONTROLLER}.run.remap", {"__ns": "/other"}, "two underscores", False),
    Hostile("remap-value-rename", f"{_CONTROLLER}.run.remap", {"a": "__node"}, "two underscores"),
    Hostile("remap-agent-topic", f"{_CONTROLLER}.run.remap", {"out": "/offload/robot/cmd_vel"}, "to the agents"),
    Hostile("remap-agent-probe", f"{_CONTROLLER}.run.remap", {"out": "/connectivity_test_local"}, "to the agents"),
    Hostile("remap-agent-relative", f"{_CONTROLLER}.run.remap", {"out": "offload/cloud/cmd_vel"}, "to the agents"),
    Hostile("remap-syntax", f"{_CONTROLLER}.run.remap", {"a": "b:=c"}, "is not a ROS name"),
    Hostile("remap-newline", f"{_CONTROLLER}.run.remap", {"a": "b\nc"}, "is not a ROS name"),
    Hostile("command-renames", f"{_CONTROLLER}.run.command", ["a", "-r", "__node:=b"], "renames the node", False),
    Hostile("command-moves", f"{_CONTROLLER}.run.command", ["a", "b:__ns:=/c"], "renames the node", False),
    Hostile("command-nul", f"{_CONTROLLER}.run.command", ["a\0b"], "that no process can be given", False),
    Hostile("parameter-nul", f"{_CONTROLLER}.run.parameters", {"a": "b\0c"}, "that no process can be given", False),
    Hostile("parameter-nul-in-list", f"{_CONTROLLER}.run.parameters", {"a": ["b\0"]}, "no process can", False),
    Hostile("env-nul", f"{_CONTROLLER}.env", [{"name": "A", "value": "b\0c"}], "no process can be given", False),
    Hostile("env-own-handover", f"{_CONTROLLER}.env", [{"name": "ROBOT_OFFLOAD_HANDOVER_URL"}], "cannot be set"),
    Hostile("env-profiles", f"{_CONTROLLER}.env", [{"name": "FASTRTPS_DEFAULT_PROFILES_FILE"}], "cannot be set"),
    Hostile("env-discovery", f"{_CONTROLLER}.env", [{"name": "FASTDDS_ENVIRONMENT_FILE"}], "cannot be set"),
    Hostile("namespace-of-agents", "spec.robot.namespace", "/offload/robot", "belongs to the agents"),
    Hostile("git-url-file-in-cluster", *_git("file:///etc"), "not from files beside the builder"),
    Hostile("git-url-dotdot", *_git("https://git.example/a/../../b"), "leaves its own folder"),
    Hostile("git-url-ssh-dash-host", *_git("ssh://-oProxyCommand=x/a"), "write https://host/path"),
    Hostile("git-url-scp-dash-host", *_git("git@-oProxyCommand:a"), "write https://host/path"),
    Hostile("git-url-port", *_git("https://git.example:99999/a"), "write https://host/path"),
    Hostile("homoglyph", "metadata.name", "r\u043ebot", r"r\u043ebot"),
    Hostile("service-of-messages", f"{_CONTROLLER}.services", [{"name": "/a", "type": "std_msgs/msg/String"}],
            "is not a service type"),
    Hostile("service-short-type", f"{_CONTROLLER}.services", [{"name": "/a", "type": "GetPlan"}], "package/srv/Type"),
    Hostile("action-of-services", f"{_CONTROLLER}.actions", [{"name": "/a", "type": "nav_msgs/srv/GetPlan"}],
            "is not an action type"),
    Hostile("action-relative", f"{_CONTROLLER}.actions", [{"name": "a", "type": "a/action/B"}], "start with a slash"),
    Hostile("action-long", f"{_CONTROLLER}.actions", [{"name": "/" + "a" * 220, "type": "a/action/B"}], "at most 213"),
    Hostile("service-of-agents", f"{_CONTROLLER}.services", [{"name": "/offload/robot/a", "type": "a/srv/B"}],
            "to the agents"),
    Hostile("used-service-of-agents", f"{_CONTROLLER}.uses", {"services": [{"name": "/offload/a", "type": "a/srv/B"}]},
            "to the agents"),
    Hostile("state-of-agents", f"{_CONTROLLER}.state", [{"topic": "/a", "restore": "/offload/cloud/a"}],
            "to the agents"),
    Hostile("state-large", f"{_CONTROLLER}.state", [{"snapshot": True, "maxSize": "17Mi"}], "at most 16Mi"),
    Hostile("state-size-decimal", f"{_CONTROLLER}.state", [{"snapshot": True, "maxSize": "1M"}], "Ki or Mi"),
    Hostile("state-parameters-path", f"{_CONTROLLER}.state", [{"parameters": {"nodes": ["a b"]}}], "is not a node"),
    Hostile("message-size-zero", "spec.switching.maxMessageSize", "0Mi", "is not a size"),
    Hostile("silent-inside", "spec.switching.silent", ["a/**/b"], "is not a name or a group"),
    Hostile("frame-slash", f"{_CONTROLLER}.outputs", [{"topic": "/tf", "frames": [{"parent": "/map", "child": "a"}]}],
            "is not a frame"),
    Hostile("services-many", f"{_CONTROLLER}.services", [{"name": f"/a{i}", "type": "a/srv/B"} for i in range(17)],
            "at most 16 fit"),
    Hostile("amcl-jumps", f"{_CONTROLLER}.run.parameters", {"set_initial_pose": True}, "configured pose", False),
    Hostile("list-of-lists", f"{_CONTROLLER}.run.parameters", {"a": [[1]]}, "a list of lists", False),
)  # fmt: skip

HARMLESS: tuple[tuple[str, Any], ...] = (
    (_EXPOSE, {"host": "a" * 63 + ".example"}),
    (_EXPOSE, {"host": "192.0.2.7"}),
    (_EXPOSE, {"address": "2001:db8::1", "loadBalancerClass": "example.com/internal"}),
    ("spec.transport", {"type": "StaticPeers", "staticPeers": {"robot": ["robot-7.vpn", "10.0.0.1", "fd00::1"]}}),
    (f"{_CONTROLLER}.image", f"registry.example:5000/team/nav2:v1@{_DIGEST}"),
    (f"{_CONTROLLER}.image", "nav2"),
    _resources(limits={"nvidia.com/gpu": 1, "memory": "1Gi"}, requests={"nvidia.com/gpu": "1", "memory": "1G"}),
    _resources(requests={"cpu": "100m", "ephemeral-storage": "1Gi"}),
    (f"{_CONTROLLER}.run.remap", {"scan": "~/scan", "~/out": "out", "/a": "/b/c"}),
    (f"{_CONTROLLER}.run.command", ["a", "--flag", "-p", "x:=1"]),
    (f"{_CONTROLLER}.run.parametersFrom", {"configMapKeyRef": {"name": "nav", "key": ".nav.yaml"}}),
    ("spec.robot.namespace", "/offloaded"),
    ("spec.cloud.nodeSelector", {"node.example.com/" + "a" * 63: "b"}),
    _git("ssh://git@git.example:2222/a.git"),
    _git("git@git.example:team/a..b.git"),
)
"""Neighbours of the hostile ones that are right."""
