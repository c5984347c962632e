"""Which node or topic a decision is about, for people: the decision itself names only what counts for it. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from robot_offload_core.control.nodes.managed_nodes import Node
from robot_offload_core.words.lifecycle import State
from robot_offload_core.words.reasons import Reason

CLOUD_NODES = (Reason.CLOUD_NOT_READY, Reason.CLOUD_NODES_DOWN)
ROBOT_NODES = (Reason.ROBOT_UNABLE, Reason.ROBOT_NOT_READY)
INPUTS = (Reason.INPUT_STALE,)
LINK = (Reason.NEVER_HEARD, Reason.HEARTBEAT_LOST)


def explained(
    reason: str, message: str, nodes: Iterable[Node], replicas: Mapping[str, str],
    problems: Iterable[tuple[str, str]], link: str,
) -> str:  # fmt: skip
    """Return the message of a decision with the nodes and topics that it is about.

    Args:
        reason: of the decision.
        message: of the decision.
        nodes: of the robot, as its guardian knows them.
        replicas: state of each node in the cloud.
        problems: (reason, message) of the robot's data process.
        link: the pulse session's problem, "" for none.
    """
    if reason in LINK:
        return f"{message}: {link}" if link else message
    found = ", ".join(_culprits(reason, message, tuple(nodes), replicas, tuple(problems)))
    return f"{message}: {found}" if found else message


def _culprits(
    reason: str, message: str, nodes: tuple[Node, ...], replicas: Mapping[str, str],
    problems: tuple[tuple[str, str], ...],
) -> list[str]:  # fmt: skip
    if reason in CLOUD_NODES:
        duplicated = [n.spec.name for n in nodes if n.spec.duplicated]
        states = {name: replicas.get(name, State.UNKNOWN.value) for name in duplicated}
        return [f"{name} is {state} there" for name, state in states.items() if state != State.ACTIVE.value]
    if reason in ROBOT_NODES:
        ours = [n for n in nodes if n.spec.duplicated and n.state is not State.ACTIVE]
        return [f"{n.spec.name} is {n.state.value} here" + (f" ({n.gave_up})" if n.gave_up else "") for n in ours]
    if reason in INPUTS:
        words = message.split()
        return [text for _, text in problems if text.partition(" ")[0] in words]
    return []
