"""What is doubtful about replicas on the robot that stay active while the cloud acts (Hot)."""

from __future__ import annotations

from collections.abc import Iterator

from robot_offload.api.v1alpha1.nodes import Node
from robot_offload.api.v1alpha1.robotoffload import RobotOffloadSpec
from robot_offload.findings import Finding


def _hot_on_robot(node: Node) -> bool:
    return node.duplicated and (not node.lifecycle or node.standby.robot == "Hot")


def hot_nodes_cost_twice(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """Warn of nodes that compute always, because they are always active there."""
    for i, node in enumerate(spec.nodes):
        if _hot_on_robot(node):
            yield Finding(
                f"spec.nodes[{i}].{'standby.robot' if node.lifecycle else 'lifecycle'}",
                "CostsTwice",
                f"node {node.name!r} computes on the robot all the time, also while the cloud acts; it takes over "
                "sooner and saves the robot nothing",
                "warning",
            )


def hot_outputs_survive_a_lost_message(spec: RobotOffloadSpec) -> Iterator[Finding]:
    """Warn of rated best-effort outputs: the robot's replica takes over for a message that is lost on the link."""
    for i, node in enumerate(spec.nodes):
        if not _hot_on_robot(node):
            continue
        for j, output in enumerate(node.outputs):
            if output.rate_hz and output.qos is not None and output.qos.reliability == "BestEffort":
                yield Finding(
                    f"spec.nodes[{i}].outputs[{j}].qos.reliability",
                    "LostMessagesEndStays",
                    f"{output.topic!r} is silent for two periods with each message that the link loses, and the Hot "
                    "replica on the robot takes over; set Reliable, or a rate below what the node publishes",
                    "warning",
                )
