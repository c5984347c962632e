"""Whether the results of each node with placement Cloud reach the robot now, and if not, why.

Such a node has no replica, so a program on the robot that uses its results must know whether they arrive. Judged by the
same limits as a stay in the cloud, except those that only concern the duplicated nodes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from robot_offload_core.control.robot.limits import cloud_fault
from robot_offload_core.control.robot.placement import Robot
from robot_offload_core.control.robot.switcher import frame
from robot_offload_core.words.lifecycle import State
from robot_offload_core.words.reasons import Reason
from robot_offload_core.words.settings import OutputSpec

NOT_CONCERNED = frozenset(
    {Reason.CONFIGURATION_DIFFERS, Reason.INPUTS_DIFFER, Reason.INPUT_STALE, Reason.COLLECTOR_FELL_BACK}
)
"""Limits of the duplicated nodes. If a node with placement Cloud lacks an input, its own silence shows that."""


@dataclass(frozen=True)
class Available:
    """Availability of one node with placement Cloud.

    Attributes:
        node: resource name.
        reason: why its results do not arrive; None while they do.
        message: for people.
    """

    node: str
    reason: Reason | None = None
    message: str = "Its results reach the robot"


def available(robot: Robot, states: Mapping[str, str], now_s: float) -> tuple[Available, ...]:
    """Return a statement for each node with placement Cloud that has outputs, in the order of the outputs.

    Args:
        robot: state of the placement machine.
        states: state of each node in the cloud, by resource name; the state of a missing node is not judged.
        now_s: on the robot's steady clock.
    """
    nodes = dict.fromkeys(name for o in robot.outputs if o.of_cloud for name in o.nodes)
    return tuple(_judge(robot, name, states.get(name, State.ACTIVE.value), now_s) for name in nodes)


def _judge(robot: Robot, node: str, state: str, now_s: float) -> Available:
    judged = frame(robot, now_s)
    fault = cloud_fault(robot.situation, robot.link, judged, robot.judged_s(now_s), acting=False, without=NOT_CONCERNED)
    if fault is not None:
        return Available(node, fault.reason, fault.message)
    if state != State.ACTIVE.value:
        return Available(node, Reason.CLOUD_NODES_DOWN, f"{node} is {state} in the cloud")
    gate = robot.situation.gate
    own = [(i, o) for i, o in enumerate(robot.outputs) if o.of_cloud and node in o.nodes]
    stale = [o.shown for i, o in own if gate is not None and i in gate.stale]
    if stale:
        limit_ms = min((o.max_age_s or robot.settings.max_command_age_s) * 1e3 for o in (o for _, o in own))
        message = f"Results arrive older than {limit_ms:.0f} ms and are left out: {', '.join(stale)}"
        return Available(node, Reason.RESULT_STALE, message)
    silent = [_shown(o) for i, o in own if o.deadline_s and gate is not None and i not in gate.cloud_flowing]
    if silent:
        return Available(node, Reason.OUTPUT_SILENT, f"Results are missing: {', '.join(silent)}")
    return Available(node)


def _shown(output: OutputSpec) -> str:
    return f"{output.shown} has been silent for more than {output.deadline_s * 1e3:.0f} ms"
