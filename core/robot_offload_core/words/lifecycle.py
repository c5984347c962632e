"""The states of a managed node (https://design.ros2.org/articles/node_lifecycle.html)."""

from __future__ import annotations

from enum import Enum


class State(str, Enum):
    """Primary states, and UNKNOWN for a node that does not answer."""

    UNKNOWN = "unknown"
    UNCONFIGURED = "unconfigured"
    INACTIVE = "inactive"
    ACTIVE = "active"
    FINALIZED = "finalized"
