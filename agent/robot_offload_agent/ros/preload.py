"""Loads what message types need (type support, numpy) before the processes are forked.

rclpy does so with the first publisher, service or client of a type: in each process, for a fifth of a second of
computing, and in memory that the processes then do not share.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import TransitionEvent
from lifecycle_msgs.srv import ChangeState, GetAvailableStates, GetAvailableTransitions, GetState
from rcl_interfaces.msg import Log, ParameterEvent
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.type_support import check_for_type_support
from std_msgs.msg import Float64, Header, Int32, String, UInt8MultiArray
from std_srvs.srv import SetBool, Trigger

from robot_offload_agent.ros.interfaces import action_types, message_type, service_type
from robot_offload_agent.settings.parameters import Configuration

OWN = (
    DiagnosticArray, TransitionEvent, ChangeState, GetAvailableStates, GetAvailableTransitions, GetState, Log,
    ParameterEvent, DescribeParameters, GetParameters, GetParameterTypes, ListParameters, SetParameters,
    SetParametersAtomically, Float64, Header, Int32, String, UInt8MultiArray, SetBool, Trigger,
)  # fmt: skip
"""Interfaces of the agent's own nodes, rclpy's parameter and lifecycle services included."""


def preload(configuration: Configuration) -> None:
    """Load the agent's own types and the declared ones; raise StartError naming one that is missing."""
    declared = {spec["type"] for spec in (*configuration.outputs, *configuration.inputs)} - {"auto"}
    for kind in (*OWN, *(message_type(name) for name in sorted(declared)), *_parts(configuration)):
        check_for_type_support(kind)


def _parts(configuration: Configuration) -> Iterator[Any]:
    """Yield the interfaces that the declared services and actions are made of."""
    for spec in (*configuration.services, *configuration.used_services):
        yield service_type(spec["type"])
    for spec in (*configuration.actions, *configuration.used_actions):
        types = action_types(spec["type"])
        yield from (types.send_goal, types.cancel_goal, types.get_result, types.feedback, types.status)
