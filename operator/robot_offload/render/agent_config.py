"""RobotOffload -> agent configuration: one ROS 2 parameter file per side, the contract with the agent.

Every key is always written, so that the file says all that the agent knows and no default lives in two places.
ROS parameters know no empty lists: an empty one is written as `["none"]`, and topics without a given type or quality
of service carry `auto` (read from the running system). Durations are floats in milliseconds.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import yaml

from robot_offload.api.v1alpha1 import Node, Output, QualityOfService, RobotOffload, Switching, TopicToCloud
from robot_offload.api.v1alpha1.names import identifier
from robot_offload.render.names import Side, nodes_on, private_topic

AUTO: Final = "auto"
NONE: Final = ["none"]
FALLBACK_AFTER_MS: Final = 5_000.0
"""Longer than a session needs to come back after the other agent restarted, so that a restart causes no fallback."""
_QOS_WORDS: Final = {
    "Reliable": "reliable",
    "BestEffort": "best_effort",
    "Volatile": "volatile",
    "TransientLocal": "transient_local",
}


@dataclass(frozen=True)
class AgentSite:
    """What an agent must know that is not in the resource: where it runs and what it was given.

    Attributes:
        side: whose agent it is.
        host: robot: the cloud's name or address; cloud: the address to listen on (`0.0.0.0` is every one).
        pulse_port: port of the pulse session as seen from this side; None = the resource's.
        data_port: port of the data session as seen from this side; None = the resource's.
        ca: file with the certificates that the other side's is checked against.
        certificate: file with this side's certificate.
        private_key: file with its key.
        verify_name: whether the robot checks that the cloud's certificate names `host`.
        uid: identity of the RobotOffload between the agents; empty = its name.
        domain_id: ROS_DOMAIN_ID of this side; None = the resource's.
        runtime_dir: folder for sockets and pid files; empty = the agent's default.
        state_dir: folder for what outlives a reboot; empty = the agent's default.
        realtime: whether the pulse process asks for real-time priority.
    """

    side: Side
    host: str
    ca: str
    certificate: str
    private_key: str
    pulse_port: int | None = None
    data_port: int | None = None
    verify_name: bool = True
    uid: str = ""
    domain_id: int | None = None
    runtime_dir: str = ""
    state_dir: str = ""
    realtime: bool = False


def agent_config(offload: RobotOffload, site: AgentSite) -> str:
    """The agent configuration of one side as the text of a ROS 2 parameter file."""
    document = {"/**": {"ros__parameters": agent_parameters(offload, site)}}
    return yaml.safe_dump(document, sort_keys=False, default_flow_style=None, width=1000, allow_unicode=True)


def agent_parameters(offload: RobotOffload, site: AgentSite) -> dict[str, Any]:
    """The agent's parameters as nested mappings, in the order in which a person reads them."""
    spec = offload.spec
    domain_id = spec.robot.domain_id if site.side == "robot" else spec.cloud_domain_id
    nodes = nodes_on(spec, site.side)
    outputs = spec.collected_outputs
    inputs = spec.topics.to_cloud
    return {
        "side": site.side,
        "uid": site.uid or offload.metadata.name,
        "robot_name": offload.metadata.name,
        "domain_id": domain_id if site.domain_id is None else site.domain_id,
        "namespace": spec.robot.namespace,
        "runtime_dir": site.runtime_dir,
        "state_dir": site.state_dir,
        "realtime": site.realtime,
        **_switching(spec.switching),
        "inhibit_service": spec.driver.inhibit_service or "",
        "link": _link(offload, site),
        "nodes": [node.name for node in nodes] or NONE,
        "node": {node.name: _node(node) for node in nodes},
        "outputs": [identifier(output.topic) for _, output in outputs] or NONE,
        "output": {identifier(output.topic): _output(node, output) for node, output in outputs},
        "inputs": [identifier(topic.name) for topic in inputs] or NONE,
        "input": {identifier(topic.name): _input(topic) for topic in inputs},
    }


def _switching(switching: Switching) -> dict[str, Any]:
    latency, hold_down = switching.latency, switching.hold_down
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
    }


def _link(offload: RobotOffload, site: AgentSite) -> dict[str, Any]:
    transport = offload.spec.transport
    zenoh = transport.zenoh
    pulse = _address(site.host, site.pulse_port or zenoh.pulse_port)
    data = _address(site.host, site.data_port or zenoh.data_port)
    own_session = transport.type == "Zenoh"
    fallback = own_session and zenoh.fallback
    return {
        "type": transport.agent_link,
        "pulse_endpoints": [f"quic/{pulse}"] if own_session else NONE,
        "data_endpoints": [f"quic/{data}"] if own_session else NONE,
        "pulse_fallback": [f"tls/{pulse}"] if fallback else NONE,
        "data_fallback": [f"tls/{data}"] if fallback else NONE,
        "fallback_after_ms": FALLBACK_AFTER_MS,
        "ca": site.ca,
        "certificate": site.certificate,
        "private_key": site.private_key,
        "verify_name": site.verify_name,
    }


def _address(host: str, port: int) -> str:
    """`host:port`, with brackets around an IPv6 address."""
    return f"[{host}]:{port}" if ":" in host and not host.startswith("[") else f"{host}:{port}"


def _node(node: Node) -> dict[str, Any]:
    return {
        "duplicated": node.duplicated,
        "core": node.core,
        "lifecycle": node.lifecycle,
        "standby_robot": node.standby.robot,
        "standby_cloud": node.standby.cloud,
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
    }


def _input(topic: TopicToCloud) -> dict[str, Any]:
    return {
        "topic": topic.name,
        "type": topic.type or AUTO,
        "max_age_ms": float(topic.max_age_ms or 0),
        "max_rate_hz": float(topic.max_rate_hz or 0.0),
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
