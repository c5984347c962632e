"""Rules about nodes whose calls several pods share."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

from robot_offload.api.v1alpha1.nodes import Node
from robot_offload.api.v1alpha1.robotoffload import RobotOffloadSpec
from robot_offload.api.v1alpha1.rules.rule import Rule
from robot_offload.findings import Finding

LONGEST_NAME: Final = 160
"""Of a pooled service: ROS 2 takes 247 characters, and the private name holds that of the pod (63)."""
_NODE: Final = "spec.nodes[]"


def _pooled(reason: str, cel: str, broken: Callable[[Node], bool], message: str) -> Rule:
    """Return a rule about nodes with `replicas`."""
    return Rule(
        _NODE, reason, f"!has(self.replicas) || {cel}", lambda node: node.replicas is not None and broken(node),
        message, "replicas",
    )  # fmt: skip


RULES: Final[tuple[Rule, ...]] = (
    _pooled(
        "OneActs",
        "self.placement == 'Cloud'",
        lambda node: node.placement != "Cloud",
        "only a node with placement Cloud has several pods: of a Duplicated node exactly one replica acts, and one "
        "with placement Robot has no pod; remove replicas",
    ),
    _pooled(
        "OnePublisher",
        "!has(self.outputs) || size(self.outputs) == 0",
        lambda node: bool(node.outputs),
        "each of several pods would publish the outputs; remove replicas, or give the outputs to a node of its own",
    ),
    _pooled(
        "GoalsNotShared",
        "!has(self.actions) || size(self.actions) == 0",
        lambda node: bool(node.actions),
        "goals are not shared among pods, only calls of services; remove replicas, or give the actions to a node of "
        "its own",
    ),
    _pooled(
        "OneLifecycle",
        "!self.lifecycle",
        lambda node: node.lifecycle,
        "several pods have no common lifecycle state, each acts from its start; write lifecycle: false",
    ),
    _pooled(
        "NothingShared",
        "has(self.services) && size(self.services) > 0",
        lambda node: not node.services,
        "pods share the calls of services, and the node offers none; list its services or remove replicas",
    ),
    _pooled(
        "NoProgram",
        "has(self.run)",
        lambda node: node.run is None,
        "each pod gets names of its own by arguments, which only run can give it; add run or remove replicas",
    ),
    _pooled(
        "TooLong",
        f"!has(self.services) || self.services.all(s, size(s.name) <= {LONGEST_NAME})",
        lambda node: any(len(it.name) > LONGEST_NAME for it in node.services),
        f"the name of a service that several pods offer has at most {LONGEST_NAME} characters; shorten it",
    ),
    Rule(
        _NODE,
        "OutOfRange",
        "!has(self.maxReplicas) || (has(self.replicas) && self.replicas <= self.maxReplicas)",
        lambda node: node.max_replicas is not None and (node.replicas is None or node.replicas > node.max_replicas),
        "maxReplicas is the upper end of a range that begins at replicas; write replicas, at most as large",
        "maxReplicas",
    ),
)


def pools_serve_the_robot(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """A client in the cloud would call the private name, which none of several pods has."""
    servers = {it.name: node.name for node in spec.nodes if node.most_pods for it in node.services}
    for i, node in enumerate(spec.nodes):
        for j, used in enumerate(node.uses.services):
            if used.name in servers:
                yield Finding(
                    f"spec.nodes[{i}].uses.services[{j}].name",
                    "NotServed",
                    f"node {node.name!r} cannot call {used.name!r} of {servers[used.name]!r}: only calls of clients on "
                    "the robot are shared among pods; remove replicas there, or this entry",
                )
