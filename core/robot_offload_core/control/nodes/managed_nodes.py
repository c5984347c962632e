"""One managed node: its observed lifecycle state and the transition under way, with deadlines and retries.

States and transitions by the names of the ROS 2 managed node design (design.ros2.org/articles/node_lifecycle.html).
A transition without an answer in time has not necessarily failed: the state is read while it is under way, and before
it is requested again. Retries wait longer each time and end at a deadline, with a reason. A node that reappears
(restarted: Unconfigured) gets a new chance.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from robot_offload_core.words.lifecycle import State
from robot_offload_core.words.reasons import Explained
from robot_offload_core.words.replace import replace
from robot_offload_core.words.settings import NodeSpec

TRANSITION_DEADLINE_S = 2.0
"""For one change_state call; a heavy on_activate takes tens of milliseconds, on_configure may load a map."""
READ_DEADLINE_S = 1.0
"""For one get_state call."""
READ_PERIOD_S = 1.0
"""How often a state is read without a report of the node: a dead node reports nothing."""
UNKNOWN_PERIOD_S = 0.25
"""The same while the state is unknown, so that a starting node is found quickly."""
RETRY_FIRST_S = 0.1
"""Wait after the first failed transition; doubled by each further one."""
RETRY_MAX_S = 5.0
"""Longest such wait."""
GIVE_UP_S = 60.0
"""After failing for this long a node is given up until it restarts or is wanted again."""
UNSEEN_LOOKS = 2
"""A node without a lifecycle is gone after this many looks at the graph in a row without it."""


class Transition(str, Enum):
    """Transitions that the guardian asks for."""

    CONFIGURE = "configure"
    ACTIVATE = "activate"
    DEACTIVATE = "deactivate"


class NodeEvent(Explained):
    """What happened to a managed node."""

    STATE_CHANGED = "StateChanged", "The node is in another lifecycle state"
    RESTARTED = "NodeRestarted", "The node is unconfigured again and is brought up again", "Look why it restarted"
    TRANSITION_FAILED = (
        "TransitionFailed", "A transition was refused or not answered, it is asked for again", "Look at the node's log"
    )  # fmt: skip
    DEGRADED = (
        "Degraded", "A node that is not CORE should be Active and is dead, refuses or was given up",
        "Look at the node's log; the robot moves without it",
    )  # fmt: skip
    GAVE_UP = "GaveUp", "Transitions failed for 60 s", "Restart the node, or switch again to retry"


GOAL = {
    Transition.CONFIGURE: State.INACTIVE,
    Transition.ACTIVATE: State.ACTIVE,
    Transition.DEACTIVATE: State.INACTIVE,
}


@dataclass(frozen=True)
class Node:
    """State of one managed node and of the calls to it.

    Attributes:
        spec: from the configuration.
        state: last observed lifecycle state.
        state_s: when it was observed.
        read_due_s: when to read it again.
        reading_until_s: deadline of a read under way; None for no read.
        asked: transition under way; None for none.
        asked_until_s: its deadline.
        failing_since_s: first failure of the present row of failures; None if healthy.
        failures: length of that row.
        retry_s: no new attempt before this time.
        gave_up: reason why no more attempts are made; "" otherwise.
        unseen: looks in a row that did not find a node without a lifecycle.
    """

    spec: NodeSpec
    state: State = State.UNKNOWN
    state_s: float | None = None
    read_due_s: float = 0.0
    reading_until_s: float | None = None
    asked: Transition | None = None
    asked_until_s: float = 0.0
    failing_since_s: float | None = None
    failures: int = 0
    retry_s: float = 0.0
    gave_up: str = ""
    unseen: int = 0


@dataclass(frozen=True)
class Observed:
    """A node's state was read or heard; UNKNOWN if a read got no answer."""

    name: str
    state: State


@dataclass(frozen=True)
class Answered:
    """A transition call was answered."""

    name: str
    transition: Transition
    success: bool


@dataclass(frozen=True)
class ChangeState:
    """Call change_state; an answer after `deadline_s` seconds is ignored."""

    name: str
    transition: Transition
    deadline_s: float


@dataclass(frozen=True)
class GetState:
    """Call get_state; report UNKNOWN if there is no answer within `deadline_s` seconds."""

    name: str
    deadline_s: float


@dataclass(frozen=True)
class Inhibit:
    """Call the driver's inhibit service with this value."""

    inhibit: bool
    reason: str


@dataclass(frozen=True)
class NodeNews:
    """For the log and diagnostics."""

    name: str
    reason: NodeEvent
    message: str


Command = ChangeState | GetState | Inhibit | NodeNews


def stays_active(node: Node) -> bool:
    """Return whether a node is Active and not about to leave that state."""
    return node.state is State.ACTIVE and node.asked is not Transition.DEACTIVATE


def observe(node: Node, state: State, now_s: float, commands: list[Command]) -> Node:
    """Take a state that was read or heard."""
    period_s = UNKNOWN_PERIOD_S if state is State.UNKNOWN else READ_PERIOD_S
    before = node.state
    node = replace(node, state=state, state_s=now_s, read_due_s=now_s + period_s, reading_until_s=None)
    if state is before:
        return node
    commands.append(NodeNews(node.spec.name, NodeEvent.STATE_CHANGED, f"{before.value} -> {state.value}"))
    if state is State.UNCONFIGURED and before is not State.UNKNOWN:
        commands.append(
            NodeNews(node.spec.name, NodeEvent.RESTARTED, "It is back in unconfigured and is brought up again")
        )
    fresh = state is State.UNCONFIGURED or before is State.UNKNOWN
    if fresh:  # a new process, or one found again: earlier failures say nothing about it
        node = replace(node, gave_up="", failures=0, failing_since_s=None, retry_s=0.0)
    if node.asked and state is GOAL[node.asked]:
        node = _healthy(node)
    return node


def look(node: Node, seen: bool, now_s: float, commands: list[Command]) -> Node:
    """Take the result of a look at the graph for a node without a lifecycle."""
    if node.spec.lifecycle:
        return node
    unseen = 0 if seen else node.unseen + 1
    if 0 < unseen < UNSEEN_LOOKS and node.state_s is not None:
        return replace(node, unseen=unseen)
    return replace(observe(node, State.ACTIVE if seen else State.UNKNOWN, now_s, commands), unseen=unseen)


def answer(node: Node, event: Answered, now_s: float, commands: list[Command]) -> Node:
    """Take the answer of a transition call."""
    if node.asked is not event.transition:
        return node
    if event.success:
        return _healthy(observe(node, GOAL[event.transition], now_s, commands))
    return _failed(node, f"{event.transition.value} was refused", now_s, commands)


def expire(node: Node, flows: bool, now_s: float, commands: list[Command]) -> Node:
    """End calls at their deadlines. A transition without an answer is followed by a read, not by a retry."""
    if node.reading_until_s is not None and now_s >= node.reading_until_s:
        if flows and node.state is State.ACTIVE:  # a long callback answers nobody; what it publishes shows its life
            return replace(node, reading_until_s=None, read_due_s=now_s + UNKNOWN_PERIOD_S)
        node = observe(node, State.UNKNOWN, now_s, commands)
    if node.asked and now_s >= node.asked_until_s:
        node = _failed(node, f"{node.asked.value} got no answer in {TRANSITION_DEADLINE_S:g} s", now_s, commands)
        node = replace(node, read_due_s=now_s, state=State.UNKNOWN)
    return node


def _healthy(node: Node) -> Node:
    return replace(node, asked=None, failures=0, failing_since_s=None, retry_s=0.0, gave_up="")


def _failed(node: Node, why: str, now_s: float, commands: list[Command]) -> Node:
    since_s = node.failing_since_s if node.failing_since_s is not None else now_s
    wait_s = min(RETRY_MAX_S, RETRY_FIRST_S * 2**node.failures)
    node = replace(
        node,
        asked=None,
        failures=node.failures + 1,
        failing_since_s=since_s,
        retry_s=now_s + wait_s,
        read_due_s=now_s,
    )
    if now_s - since_s >= GIVE_UP_S:
        node = replace(node, gave_up=f"{why}, {node.failures} times in {now_s - since_s:.0f} s")
        commands.append(
            NodeNews(node.spec.name, NodeEvent.GAVE_UP, f"{node.gave_up}; restart the node or switch again to retry")
        )
    else:
        commands.append(NodeNews(node.spec.name, NodeEvent.TRANSITION_FAILED, f"{why}, next attempt in {wait_s:.1f} s"))
    return node


def rises(node: Node) -> bool:
    """Return whether a node is on its way up for the first time; a dead or refusing node holds up no other."""
    unread = node.state_s is None
    return unread or (node.state in (State.UNCONFIGURED, State.INACTIVE) and node.failures == 0 and not node.gave_up)


def upwards(node: Node) -> Transition | None:
    """Return the transition that leads towards Active; None if there is none."""
    if node.state is State.UNCONFIGURED:
        return Transition.CONFIGURE
    return Transition.ACTIVATE if node.state is State.INACTIVE else None


def ask(node: Node, transition: Transition | None, now_s: float, commands: list[Command]) -> Node:
    """Ask for a transition, unless one is under way, the node was given up or its next attempt is not due."""
    if transition is None or node.asked is not None or node.gave_up or now_s < node.retry_s:
        return node
    commands.append(ChangeState(node.spec.name, transition, TRANSITION_DEADLINE_S))
    return replace(node, asked=transition, asked_until_s=now_s + TRANSITION_DEADLINE_S)
