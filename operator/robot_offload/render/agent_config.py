"""RobotOffload -> agent configuration: one ROS 2 parameter file per side, the contract with the agent.

Every key is always written, so that the file holds all of the agent's settings and no default is in two places. ROS
parameters have no empty lists: an empty one is written as `["none"]`, and topics without a given type or quality
of service carry `auto` (read from the running system). Durations are floats in milliseconds.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import yaml

from robot_offload import transport
from robot_offload.api.v1alpha1 import (
    Node,
    Output,
    QualityOfService,
    Record,
    RobotOffload,
    Switching,
    TopicToCloud,
    While,
)
from robot_offload.api.v1alpha1.names import Side, identifier
from robot_offload.api.v1alpha1.nodes import flat_parameters
from robot_offload.objects.site import AgentSite
from robot_offload.render.agent_names import handed_over, hot_sides, listed
from robot_offload.render.ros_names import nodes_on, private_topic

__all__ = ["AgentSite", "agent_config", "agent_parameters", "parameter_file", "runtime_parameters", "start_parameters"]

AUTO: Final = "auto"
PREPARE_MS: Final = 5_000
"""Time for goals to be accepted on the side that prepares; costmaps fill meanwhile."""
FALLBACK_AFTER_MS: Final = 5_000.0
"""Longer than a session takes to return after the other agent restarted: a restart causes no fallback."""
RUN_TIME: Final = frozenset(
    (
        "generation", "mode", "pin", "prefer", "loss_timeout_ms", "lease_ms", "max_command_age_ms", "robot_period_ms",
        "cloud_period_ms", "tolerance_ms", "min_dwell_ms", "hold_down_initial_ms", "hold_down_max_ms",
        "flap_window_ms", "activation_deadline_ms", "max_clock_offset_ms",
    )
)  # fmt: skip
"""Settings that running agents adopt; a contract test compares it with the agent's own list."""
RUN_TIME_INPUT: Final = frozenset(("max_age_ms", "max_rate_hz"))
"""The same of each input."""
SHARED: Final = RUN_TIME | {
    "domain_id", "namespace", "heartbeat_period_ms", "strict", "inhibit_service", "nodes", "node", "outputs", "output",
    "inputs", "input", "services", "service", "actions", "action", "used_services", "used_service", "used_actions",
    "used_action", "states", "state", "silent", "max_message_size", "prepare_deadline_ms", "cancel_deadline_ms",
    "settle_for_ms", "record",
}  # fmt: skip
"""Settings that depend on the resource alone, not on where an agent runs."""
_DUMPER: Final = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
"""In C if PyYAML has it: an operator of many robots writes these files in every pass over each."""
BLACK_BOX_MIB: Final[dict[Side, int]] = {"robot": 64, "cloud": 8}
"""Size of the agents' record of their own decisions; the robot's file may set another size."""
_QOS_WORDS: Final = {
    "Reliable": "reliable",
    "BestEffort": "best_effort",
    "Volatile": "volatile",
    "TransientLocal": "transient_local",
}


def agent_config(offload: RobotOffload, site: AgentSite) -> str:
    """Return the agent configuration of one side as the text of a ROS 2 parameter file."""
    return parameter_file(agent_parameters(offload, site))


def parameter_file(parameters: Mapping[str, Any], author: str = "") -> str:
    """Return nested parameters as a ROS 2 parameter file for every node; `author`: their last author."""
    document: dict[str, Any] = {"/**": {"ros__parameters": dict(parameters)}}
    if author:
        document["changed_by"] = author  # beside the parameters: agents of earlier releases ignore it
    return yaml.dump(document, Dumper=_DUMPER, sort_keys=False, default_flow_style=None, width=1000, allow_unicode=True)


def agent_parameters(offload: RobotOffload, site: AgentSite) -> dict[str, Any]:
    """Return the agent's parameters as nested mappings, in an order for human readers."""
    spec = offload.spec
    domain_id = spec.robot.domain_id if site.side == "robot" else spec.cloud_domain_id
    nodes = nodes_on(spec, site.side)
    outputs = spec.collected_outputs
    inputs = spec.topics.to_cloud
    parameters = {
        "side": site.side,
        "uid": site.uid or offload.metadata.name,
        "robot_name": offload.metadata.name,
        "domain_id": domain_id if site.domain_id is None else site.domain_id,
        "namespace": spec.robot.namespace,
        "runtime_dir": site.runtime_dir,
        "state_dir": site.state_dir,
        "black_box_mib": BLACK_BOX_MIB[site.side],
        "realtime": site.realtime,
        **_files(site),
        **_switching(spec.switching, with_actions=any(node.actions for node in spec.nodes)),
        "inhibit_service": spec.driver.inhibit_service or "",
        "record": _record(spec.record),
        "link": _link(offload, site),
        "nodes": listed(node.name for node in nodes),
        "node": {node.name: _node(node) for node in nodes},
        "outputs": listed(identifier(output.topic) for _, output in outputs),
        "output": {identifier(output.topic): _output(node, output) for node, output in outputs},
        "inputs": listed(identifier(topic.name) for topic in inputs),
        "input": {identifier(topic.name): _input(topic) for topic in inputs},
        **handed_over(spec),
    }
    # rcl's reader of parameter files refuses a file in which something follows an empty mapping.
    return {name: value for name, value in parameters.items() if value != {}}


def runtime_parameters(offload: RobotOffload, generation: int) -> dict[str, Any]:
    """Return the settings that the cloud's agent pushes to a connected robot: all shared ones, always complete.

    The robot adopts those that may change while it runs (see RUN_TIME) and compares the rest with its own file: it
    reports a difference there, which needs a new bundle.

    Args:
        offload: the resource.
        generation: of its specification.
    """
    robot = agent_parameters(offload, AgentSite("robot", "", "", "", "", generation=generation))
    return {name: value for name, value in robot.items() if name in SHARED}


def start_parameters(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Return an agent's parameters without those that it adopts while it runs: the ones that need a restart."""
    kept = {name: value for name, value in parameters.items() if name not in RUN_TIME}
    inputs = {
        name: {key: value for key, value in values.items() if key not in RUN_TIME_INPUT}
        for name, values in parameters.get("input", {}).items()
    }
    return {**kept, "input": inputs}


def _files(site: AgentSite) -> dict[str, Any]:
    return {
        "generation": site.generation,
        "state_file": site.state_file,
        "settings_file": site.settings_file,
        "handover_file": site.handover_file,
        "certificate_file": site.certificate_file,
    }


def _switching(switching: Switching, *, with_actions: bool) -> dict[str, Any]:
    latency, hold_down = switching.latency, switching.hold_down
    prepare_ms = switching.prepare_deadline_ms
    if prepare_ms is None:  # 0: the activation deadline, which may change while the agents run
        prepare_ms = max(PREPARE_MS, switching.activation_deadline_ms) if with_actions else 0
    return {
        "mode": switching.mode,
        "pin": switching.pin,
        "prefer": switching.prefer,
        "strict": switching.strict,
        "heartbeat_period_ms": float(switching.heartbeat_period_ms),
        "loss_timeout_ms": float(switching.loss_timeout_ms),
        "lease_ms": float(switching.lease_ms),
        "max_command_age_ms": float(switching.max_command_age_ms),
        "robot_period_ms": float(latency.robot_period_ms),
        "cloud_period_ms": float(latency.cloud_period_ms),
        "tolerance_ms": float(latency.tolerance_ms),
        "min_dwell_ms": float(switching.min_dwell_ms),
        "hold_down_initial_ms": float(hold_down.initial_ms),
        "hold_down_max_ms": float(hold_down.max_ms),
        "flap_window_ms": float(hold_down.flap_window_ms),
        "activation_deadline_ms": float(switching.activation_deadline_ms),
        "max_clock_offset_ms": float(switching.max_clock_offset_ms),
        "prepare_deadline_ms": float(prepare_ms),
        "cancel_deadline_ms": float(switching.cancel_deadline_ms),
        "settle_for_ms": float(switching.settle_for_ms),
        "max_message_size": switching.max_message_size,
        "silent": listed(switching.silent),
    }


def _record(record: Record) -> dict[str, Any]:
    return {
        "switches": record.switches,
        "before_ms": float(record.before_ms),
        "after_ms": float(record.after_ms),
        "keep": record.keep,
        "max_mib": max(1, record.max_size >> 20),
    }


def _link(offload: RobotOffload, site: AgentSite) -> dict[str, Any]:
    return {
        "type": offload.spec.transport.agent_link,
        **transport.of(offload.spec).agent_link(offload, site),
        "fallback_after_ms": FALLBACK_AFTER_MS,
        "ca": site.ca,
        "certificate": site.certificate,
        "private_key": site.private_key,
        "peer_name": site.peer_name or ("cloud" if site.side == "robot" else offload.metadata.name),
        "observers": listed(site.observers),
        "verify_name": site.verify_name,
    }


def _node(node: Node) -> dict[str, Any]:
    hot = hot_sides(node)
    return {
        "duplicated": node.duplicated,
        "core": node.core,
        "lifecycle": node.lifecycle,
        # Sorted, because reordering them is not a change.
        "may_differ": listed(
            sorted(name for name, _ in flat_parameters(node.run.cloud_parameters if node.run else {}))
        ),
        "standby_robot": "Hot" if "robot" in hot else "Warm",
        # A Cold replica without a pod is simply absent; once it runs it is kept like a Warm one.
        "standby_cloud": "Hot" if "cloud" in hot else "Warm",
    }


def _output(node: Node, output: Output) -> dict[str, Any]:
    return {
        "topic": output.topic,
        "type": output.type or AUTO,
        "rate_hz": float(output.rate_hz or 0.0),
        "deadline_ms": output.judged_after_ms,
        "mirror": output.mirror,
        "robot_topic": private_topic("robot", output.topic),
        "cloud_topic": private_topic("cloud", output.topic),
        "node": node.name,
        **_qos(output.qos),
        **_condition(output.while_),
        "shared": output.shared or bool(output.frames),
        "frames": listed(f"{frame.parent} {frame.child}" for frame in output.frames),
        "of_cloud": node.placement == "Cloud",
        "max_age_ms": float(output.max_age_ms or 0),
        "hot": listed(hot_sides(node)),
        "waits": bool(node.called),
    }


def _condition(while_: While | None) -> dict[str, Any]:
    condition = while_ or While()
    return {
        "while_actions": listed(condition.actions),
        "while_topic": condition.topic or "",
        "while_within_ms": float(condition.within_ms or 0),
    }


def _input(topic: TopicToCloud) -> dict[str, Any]:
    return {
        "topic": topic.name,
        "type": topic.type or AUTO,
        "max_age_ms": float(topic.max_age_ms or 0),
        "max_rate_hz": float(topic.max_rate_hz or 0.0),
        "min_rate_hz": float(topic.min_rate_hz or 0.0),
        "priority": topic.priority,
        "latest": topic.latest,
        "latched": topic.latched,
        **_qos(topic.qos),
    }


def _qos(qos: QualityOfService | None) -> dict[str, Any]:
    chosen = qos or QualityOfService()
    return {
        "reliability": _QOS_WORDS.get(chosen.reliability or "", AUTO),
        "durability": _QOS_WORDS.get(chosen.durability or "", AUTO),
        "depth": chosen.depth,
    }
