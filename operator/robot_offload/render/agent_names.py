"""A RobotOffload's services, actions and state as parameters of the agents, the same on both sides."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Final

from robot_offload.api.v1alpha1 import Action, Node, RobotOffloadSpec, Service, State
from robot_offload.api.v1alpha1.names import SIDES, Side, identifier
from robot_offload.api.v1alpha1.served import SNAPSHOT_MAX_AGE_MS, SNAPSHOT_MAX_SIZE

NONE: Final = ["none"]
CLOUD_ENDS: Final = "Abort"
DEFAULT_ON_SWITCH: Final = "ResendOnLoss"
"""The fate of a goal at a Cloud node when the cloud is lost: no other replica could continue it."""


def listed(names: Iterable[str]) -> list[str]:
    """Return a new list each time: YAML writes a second mention of the same one as an alias, which ROS cannot read."""
    return list(names) or list(NONE)


def hot_sides(node: Node) -> tuple[Side, ...]:
    """Return the sides on which a duplicated node is active in standby; one without a lifecycle always is."""
    if not node.duplicated:
        return ()
    hot = {"robot": node.standby.robot == "Hot", "cloud": node.standby.cloud == "Hot"}
    return tuple(side for side in SIDES if hot[side] or not node.lifecycle)


def handed_over(spec: RobotOffloadSpec) -> dict[str, Any]:
    """Return the parameters of services, actions and state, as nested mappings."""
    group = {it.name for node in spec.nodes for it in node.offered}
    services = {identifier(it.name): _service(node, it) for node in spec.nodes for it in node.services}
    actions = {identifier(it.name): _action(node, it) for node in spec.nodes for it in node.actions}
    # The group's own clients call what it offers under the private name, without a relay.
    used_services = {
        identifier(it.name): {"name": it.name, "type": it.type, "timeout_ms": float(it.timeout_ms), **_client(node)}
        for node in spec.nodes
        for it in node.uses.services
        if it.name not in group
    }
    used_actions = {
        identifier(it.name): {
            "name": it.name,
            "type": it.type,
            "cancel_after_ms": float(it.cancel_after_ms),
            "timeout_ms": float(it.timeout_ms),
            **_client(node),
        }
        for node in spec.nodes
        for it in node.uses.actions
        if it.name not in group
    }
    states = {name: _state(node, it) for node in spec.nodes for name, it in node.named_state}
    groups = {"service": services, "action": actions, "used_service": used_services, "used_action": used_actions,
              "state": states}  # fmt: skip
    return {f"{group}s": listed(them) for group, them in groups.items()} | groups


def _client(node: Node) -> dict[str, Any]:
    return {"node": node.name, "of_cloud": node.placement == "Cloud"}


def _server(node: Node) -> dict[str, Any]:
    return {**_client(node), "core": node.core, "hot": listed(hot_sides(node))}


def _service(node: Node, service: Service) -> dict[str, Any]:
    return {
        "name": service.name,
        "type": service.type,
        "mode": service.mode,
        "timeout_ms": float(service.timeout_ms),
        "pooled": node.most_pods > 0,
        **_server(node),
    }


def _action(node: Node, action: Action) -> dict[str, Any]:
    return {
        "name": action.name,
        "type": action.type,
        "on_switch": action.on_switch or (DEFAULT_ON_SWITCH if node.duplicated else CLOUD_ENDS),
        "accept": action.accept,
        "hold_for_ms": float(action.hold_for_ms or 0),
        "timeout_ms": float(action.timeout_ms),
        "result_timeout_ms": float(action.result_timeout_ms),
        "mirror": action.mirror,
        **_server(node),
    }


def _state(node: Node, state: State) -> dict[str, Any]:
    kind = "Topic" if state.topic is not None else "Snapshot" if state.snapshot else "Parameters"
    parameters = state.parameters
    return {
        "node": node.name,
        "kind": kind,
        "topic": state.topic or "",
        "restore": state.restore or "",
        "nodes": listed(parameters.nodes if parameters is not None else ()),
        "except": listed(parameters.except_ if parameters is not None else ()),
        "max_age_ms": float(SNAPSHOT_MAX_AGE_MS if state.max_age_ms is None else state.max_age_ms),
        "max_size": SNAPSHOT_MAX_SIZE if state.max_size is None else state.max_size,
    }
