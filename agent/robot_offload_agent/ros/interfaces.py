"""Interface types by their names, as a graph or a parameter file gives them."""

from __future__ import annotations

import importlib
import re
from dataclasses import dataclass
from typing import Any

from robot_offload_agent.errors import StartError

SETUP_VARIABLE = "ROBOT_OFFLOAD_SETUP"
_OF_ACTION = re.compile(r"(.+/action/[A-Za-z0-9]+)_(FeedbackMessage|GetResult_Event)")
_NAME = re.compile(r"([A-Za-z][A-Za-z0-9_]*)/(msg|srv|action)/([A-Za-z][A-Za-z0-9_]*)")


@dataclass(frozen=True)
class ActionTypes:
    """The parts of an action: three services and two messages."""

    send_goal: Any
    cancel_goal: Any
    get_result: Any
    feedback: Any
    status: Any


def any_type(name: str) -> Any:
    """Return the class of a type of any kind; see `interface`."""
    match = _NAME.fullmatch(name)
    return interface(name, match[2] if match else "msg")


def message_type(name: str) -> Any:
    """Return the class of a message type such as `sensor_msgs/msg/LaserScan`; see `interface`.

    Includes the messages of an action: its feedback with the goal's id, and the event of a `get_result`.
    """
    part = _OF_ACTION.fullmatch(name)
    if part is not None:
        types = action_types(part[1])
        return types.feedback if part[2] == "FeedbackMessage" else types.get_result.Event
    return interface(name, "msg")


def service_type(name: str) -> Any:
    """Return the class of a service type such as `nav_msgs/srv/GetPlan`; see `interface`."""
    return interface(name, "srv")


def action_types(name: str) -> ActionTypes:
    """Return the parts of an action type such as `nav2_msgs/action/FollowPath`; see `interface`."""
    parts = interface(name, "action").Impl
    return ActionTypes(
        parts.SendGoalService, parts.CancelGoalService, parts.GetResultService, parts.FeedbackMessage,
        parts.GoalStatusMessage,
    )  # fmt: skip


def interface(name: str, kind: str) -> Any:
    """Return the class of an interface type.

    Args:
        name: `PACKAGE/KIND/TYPE`; any program in the graph can give a topic any type.
        kind: `msg`, `srv` or `action`.

    Raises:
        StartError: it cannot be imported; names the package.
    """
    match = _NAME.fullmatch(name)
    if match is None or match[2] != kind:
        raise StartError(f"{name!r:.100} is not an interface type of kind {kind}; write PACKAGE/{kind}/TYPE")
    package, _, short = match.groups()
    try:
        return getattr(importlib.import_module(f"{package}.{kind}"), short)
    except (ImportError, AttributeError) as error:
        raise StartError(
            f"Interface type {name} cannot be imported here: no installed package {package} has it; run the agent "
            f"inside the overlay that has it ({SETUP_VARIABLE} in the bundle's `environment`), or build it into the "
            "agent's image"
        ) from error
