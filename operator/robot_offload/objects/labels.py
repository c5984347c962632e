"""The labels of all children, for finding them and their pods."""

from __future__ import annotations

from typing import Final, Literal, TypeAlias

from robot_offload.api.v1alpha1 import RobotOffload

Component: TypeAlias = Literal["agent", "node", "discovery", "router", "settings", "certificates", "network", "build"]

NAME: Final = "app.kubernetes.io/name"
INSTANCE: Final = "app.kubernetes.io/instance"
COMPONENT: Final = "app.kubernetes.io/component"
MANAGED_BY: Final = "app.kubernetes.io/managed-by"
NODE: Final = "robotoffload.dev/node"
MOST_PODS: Final = "robotoffload.dev/max-replicas"
"""Annotation of a Deployment that an autoscaler may scale: its maximum of pods."""
MANAGER: Final = "robot-offload"


def instance_labels(offload: RobotOffload) -> dict[str, str]:
    """Return the labels for finding all children of a RobotOffload."""
    return {NAME: MANAGER, INSTANCE: offload.metadata.name}


def labels(offload: RobotOffload, component: Component) -> dict[str, str]:
    """Return the labels of a child."""
    return {**selector(offload, component), MANAGED_BY: MANAGER}


def selector(offload: RobotOffload, component: Component) -> dict[str, str]:
    """Return the labels with which a Service, a Deployment or a policy selects its pods; they never change."""
    return {**instance_labels(offload), COMPONENT: component}
