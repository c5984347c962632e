"""The names of a RobotOffload in ROS 2, and the arguments that give a node these names.

The nodes are unchanged: everything is remapping. A replica in the cloud is called `remote_NAME`; the outputs of nodes
that run in the cloud are published under private topics, one per side, and the collector publishes the public one.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from robot_offload.api.v1alpha1 import Node, RobotOffloadSpec, Run
from robot_offload.api.v1alpha1.name_rules import REMOTE_PREFIX
from robot_offload.api.v1alpha1.names import Side

ACTION_PARTS: Final = ("send_goal", "cancel_goal", "get_result", "feedback", "status")
"""The hidden services and topics of an action: rclpy and rclcpp create the same five."""


THIS_POD: Final = "pod_this"
"""Placeholder for the pod's own name in the private names of a node with several pods, until the pod starts."""


def private_topic(side: Side, topic: str) -> str:
    """Return one side's private name for a name that goes through the agent: `/cmd_vel` -> `/offload/robot/cmd_vel`."""
    return f"/offload/{side}{topic}"


def served_name(node: Node, side: Side, name: str) -> str:
    """Return a node's private name for one that goes through the agent; a service of several pods has one in each."""
    pooled = node.most_pods > 0 and side == "cloud" and any(it.name == name for it in node.services)
    return private_topic(side, f"/{THIS_POD}{name}" if pooled else name)


def replica_name(node: Node, side: Side) -> str:
    """Return the ROS name of a node on one side: the cloud's replica of a duplicated node has the prefix."""
    return f"{REMOTE_PREFIX}{node.name}" if side == "cloud" and node.duplicated else node.name


def nodes_on(spec: RobotOffloadSpec, side: Side) -> tuple[Node, ...]:
    """Return the nodes that run on one side, in bring-up order."""
    placements = {"robot": ("Robot", "Duplicated"), "cloud": ("Cloud", "Duplicated")}[side]
    return tuple(node for node in spec.nodes if node.placement in placements)


def command(spec: RobotOffloadSpec, node: Node, side: Side, *, params_file: str | None = None) -> tuple[str, ...]:
    """Return the command line of a node's replica on one side, with all ROS arguments.

    Args:
        spec: the whole specification.
        node: the node.
        side: of the replica.
        params_file: a ROS 2 parameter file on that side; single parameters override it.

    Raises:
        ValueError: the node has no `run` block, so it must be started otherwise.
    """
    if node.run is None:
        raise ValueError(f"node {node.name!r} has no run block: nothing says how to start it")
    program = node.run.command or ("ros2", "run", str(node.run.package), str(node.run.executable))
    file = () if params_file is None else ("--params-file", params_file)
    # Later parameters win, so the file comes first.
    return (*program, "--ros-args", *file, *run_arguments(spec, node, side))


def shared_command(
    spec: RobotOffloadSpec, program: Sequence[str], nodes: Sequence[Node], side: Side
) -> tuple[str, ...]:
    """Return the command line of a process that runs several nodes on one side, with their names as arguments.

    Every rule except that of the name is bound to its node, by its name at that time (rcl `remap.c`).
    """
    arguments: list[str] = []
    for node in nodes:
        name = replica_name(node, side)
        own = run_arguments(spec, node, side)
        for flag, rule in zip(own[::2], own[1::2], strict=True):
            arguments += [flag, rule if ":__" in rule else f"{name}:{rule}"]
    return (*program, *(node.name for node in nodes), "--ros-args", *arguments)


def run_arguments(spec: RobotOffloadSpec, node: Node, side: Side) -> tuple[str, ...]:
    """Return the arguments after `--ros-args` for a node's replica on one side.

    The node rule is always `OLD:__node:=NEW`: without OLD it would rename every node of the process. The namespace
    rule names the new name, because ROS 2 renames first (rcl `node.c`).
    """
    name = replica_name(node, side)
    arguments = ["-r", f"{node.name}:__node:={name}"]
    if spec.robot.namespace != "/":
        arguments += ["-r", f"{name}:__ns:={spec.robot.namespace}"]
    for source, target in remappings(spec, node, side).items():
        arguments += ["-r", f"{source}:={target}"]
    for parameter, value in parameters(node.run, side).items():
        arguments += ["-p", f"{parameter}:={parameter_text(value)}"]
    return tuple(arguments)


def remappings(spec: RobotOffloadSpec, node: Node, side: Side) -> dict[str, str]:
    """Return a node's name remappings: the user's own, and to private names for all that goes through the agent.

    ROS 2 applies one rule to a name, never a second one to its result; so a user's rule that leads to an output leads
    directly to the private topic. An action is renamed by its hidden names: before Kilted a rule for the action's
    own name does nothing (rcl #1170).
    """
    own = dict(node.run.remap) if node.run else {}
    plain, actions = private_names(node), action_names(node)
    rules: dict[str, str] = {}
    for source, target in own.items():
        full = _absolute(target, spec.robot.namespace)
        if full in actions:
            rules |= _hidden_rules(source, private_topic(side, full))
        else:
            rules[source] = served_name(node, side, full) if full in plain else target
    for name in plain:
        rules.setdefault(name, served_name(node, side, name))
    for name in actions:
        rules = _hidden_rules(name, private_topic(side, name)) | rules
    return rules


def private_names(node: Node) -> tuple[str, ...]:
    """Return the topics and services of a node that go through the agent."""
    outputs = [output.topic for output in node.outputs] if node.in_cloud else []
    services = [*(it.name for it in node.services), *(it.name for it in node.uses.services)]
    restored = [state.restore for state in node.state if state.restore is not None]
    return tuple(dict.fromkeys((*outputs, *services, *restored)))


def action_names(node: Node) -> tuple[str, ...]:
    """Return the actions of a node that go through the agent, offered and used."""
    return tuple(dict.fromkeys([*(it.name for it in node.actions), *(it.name for it in node.uses.actions)]))


def _hidden_rules(action: str, private: str) -> dict[str, str]:
    return {f"{action}/_action/{part}": f"{private}/_action/{part}" for part in ACTION_PARTS}


def _absolute(name: str, namespace: str) -> str:
    return name if name.startswith("/") else f"{namespace.rstrip('/')}/{name}"


def parameters(run: Run | None, side: Side) -> dict[str, Any]:
    """Return the parameters of a replica by dotted names; the cloud's override the common ones."""
    if run is None:
        return {}
    flat = dict(_flat(run.parameters))
    if side == "cloud":
        flat |= dict(_flat(run.cloud_parameters))
    return flat


def _flat(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def parameter_text(value: object) -> str:
    """Return a parameter's value so that ROS 2 reads the same type: text always quoted, numbers never."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return repr(value) if math.isfinite(value) else _not_finite(value)
    if isinstance(value, tuple | list):
        return f"[{', '.join(parameter_text(item) for item in value)}]"
    return json.dumps(value, ensure_ascii=False) if isinstance(value, str) else str(value)


def _not_finite(value: float) -> str:
    if math.isnan(value):
        return ".nan"
    return ".inf" if value > 0 else "-.inf"
