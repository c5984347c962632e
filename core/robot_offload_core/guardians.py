"""Wanted against observed lifecycle states -> ordered transitions with deadlines and retries, and the CORE rule.

States and transitions by the names of the ROS 2 managed node design (design.ros2.org/articles/node_lifecycle.html).
Bring-up follows the order of the list, going to sleep the reverse; a CORE node waits for CORE nodes only, and nobody
waits for a node that is dead or refuses. A transition whose answer does not come in time has not necessarily failed:
the state is read while it is under way and before it is asked for again. Retries wait longer each time and end at a
deadline, with a reason; a node that shows up again (restarted: Unconfigured) gets a new chance.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from operator import is_

from robot_offload_core.change import replace
from robot_offload_core.checks import require
from robot_offload_core.events import Acting, Tick, assert_never
from robot_offload_core.reasons import Explained, silence
from robot_offload_core.settings import NodeSpec
from robot_offload_core.token import Site

TRANSITION_DEADLINE_S = 2.0
"""For one change_state call; a heavy on_activate takes tens of milliseconds, on_configure may load a map."""
READ_DEADLINE_S = 1.0
READ_PERIOD_S = 1.0
"""How often a state is read again although nothing was heard (a node that died says nothing)."""
UNKNOWN_PERIOD_S = 0.25
"""The same while the state is unknown: a node that starts is to be found quickly."""
RETRY_FIRST_S = 0.1
RETRY_MAX_S = 5.0
GIVE_UP_S = 60.0
"""After failing for this long a node is given up until it restarts or is asked for again."""
UNSEEN_LOOKS = 2
"""A node without a lifecycle is gone when so many looks at the graph in a row do not find it."""
INHIBIT_PERIOD_S = 0.5
"""Repetition of an unconfirmed inhibit request, and of a standing one in case the driver restarted."""


class State(str, Enum):
    """Primary states, and UNKNOWN for a node that does not answer."""

    UNKNOWN = "unknown"
    UNCONFIGURED = "unconfigured"
    INACTIVE = "inactive"
    ACTIVE = "active"
    FINALIZED = "finalized"


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
    """What is known of one managed node and what is under way with it.

    Attributes:
        spec: from the configuration.
        state: last observed.
        state_s: when.
        read_due_s: when to read it again.
        reading_until_s: deadline of a read under way; None when none.
        asked: transition under way; None when none.
        asked_until_s: its deadline.
        failing_since_s: first failure of the present row of failures; None when healthy.
        failures: length of that row.
        retry_s: no new attempt before this.
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
class Guardian:
    """State of one side's guardian.

    Attributes:
        nodes: in bring-up order.
        acting: this side is in charge or gets ready to be: its duplicated nodes are to be Active.
        acting_since_s: since when.
        in_charge: it is in charge; only then its duplicated CORE nodes matter to the driver.
        outputs_flow: the rated outputs of this side flow (judged by the collector).
        outputs_heard, silent, stop: see Acting. flowing: see Flowing.
        grace_s: how long a CORE node may be on its way to Active before the driver is inhibited.
        has_driver: there is an inhibit service (the robot's side).
        inhibited: last confirmed by the driver; None before the first confirmation.
        inhibit_said: last asked of the driver; None before the first time.
        inhibit_due_s: when to say it again.
        fault_since_s: since when the CORE rule has been broken.
    """

    nodes: tuple[Node, ...]
    grace_s: float
    has_driver: bool = False
    acting: bool = False
    acting_since_s: float = 0.0
    in_charge: bool = False
    outputs_flow: bool = True
    outputs_heard: bool = True
    silent: tuple[str, ...] = ()
    flowing: tuple[str, ...] = ()
    stop: str = ""
    inhibited: bool | None = None
    inhibit_said: bool | None = None
    inhibit_due_s: float = 0.0
    fault_since_s: float | None = None


@dataclass(frozen=True)
class Observed:
    """A node's state was read or heard; UNKNOWN when a read got no answer."""

    name: str
    state: State


@dataclass(frozen=True)
class Answered:
    """A transition call was answered."""

    name: str
    transition: Transition
    success: bool


@dataclass(frozen=True)
class Flowing:
    """Level: the nodes all of whose rated outputs flow. One that is too busy to answer a read is not dead."""

    names: tuple[str, ...]


@dataclass(frozen=True)
class Seen:
    """Level: the nodes without a lifecycle whose process and declared names are in the graph.

    They are Active from their start on, on both sides: that they live is observed, because nobody can ask them.
    """

    names: tuple[str, ...]


@dataclass(frozen=True)
class InhibitAnswered:
    """The driver confirmed an inhibit request."""

    inhibited: bool


Event = Observed | Answered | Acting | Flowing | Seen | InhibitAnswered | Tick


@dataclass(frozen=True)
class ChangeState:
    """Call change_state; an answer after `deadline_s` seconds is ignored."""

    name: str
    transition: Transition
    deadline_s: float


@dataclass(frozen=True)
class GetState:
    """Call get_state; report UNKNOWN when there is no answer within `deadline_s` seconds."""

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


def start(specs: Iterable[NodeSpec], grace_s: float, has_driver: bool = False) -> Guardian:
    """A guardian that knows nothing yet."""
    return Guardian(tuple(Node(spec) for spec in specs), grace_s, has_driver)


def step(guardian: Guardian, event: Event, now_s: float) -> tuple[Guardian, list[Command]]:
    """Takes in one event and does all that has become due."""
    commands: list[Command] = []
    before = guardian
    match event:
        case Observed(name, state):
            guardian = _each(guardian, name, lambda n: _observe(n, state, now_s, commands))
        case Answered():
            guardian = _each(guardian, event.name, lambda n: _answer(n, event, now_s, commands))
        case Acting():
            guardian = _act(guardian, event, now_s)
        case Flowing():
            guardian = replace(guardian, flowing=event.names)
        case Seen():
            nodes = tuple(_look(n, n.spec.name in event.names, now_s, commands) for n in guardian.nodes)
            guardian = replace(guardian, nodes=nodes)
        case InhibitAnswered():
            guardian = replace(guardian, inhibited=event.inhibited)
        case Tick():
            pass
        case _:
            assert_never(event)
    nodes = tuple([_expire(node, node.spec.name in guardian.flowing, now_s, commands) for node in guardian.nodes])
    guardian = _advance(_with(guardian, nodes), now_s, commands)
    guardian = _core_rule(guardian, now_s, commands)
    check(before, guardian, event)
    return guardian, commands


def check(before: Guardian, after: Guardian, event: Event) -> None:
    """Raises InvariantError when the step from `before` to `after` broke what every step must keep."""
    require(
        "guardian",
        event,
        (len(after.nodes) == len(before.nodes), "a node was lost"),
        (all(n.asked is None or n.spec.lifecycle for n in after.nodes), "a transition of a node without a lifecycle"),
        (after.acting or not after.in_charge, "in charge without acting"),
        (after.has_driver or after.inhibit_said is None, "a driver was inhibited that does not exist"),
    )


def is_ready(guardian: Guardian) -> bool:
    """All duplicated CORE nodes (all duplicated ones when none is CORE) are Active and not on their way out of it.

    Those without a lifecycle are seen.
    """
    duplicated = [n for n in guardian.nodes if n.spec.duplicated]
    core = [n for n in duplicated if n.spec.core] or duplicated
    return all(_stays_active(n) for n in core)


def _stays_active(node: Node) -> bool:
    return node.state is State.ACTIVE and node.asked is not Transition.DEACTIVATE


def core_fault(guardian: Guardian) -> str:
    """Why the robot must not move now; "" when it may."""
    if guardian.stop:
        return guardian.stop
    for node in guardian.nodes:
        concerned = node.spec.core and (guardian.in_charge if node.spec.duplicated else node.spec.lifecycle)
        if concerned and node.state is not State.ACTIVE:
            return f"CORE node {node.spec.name} is {node.state.value}"
    return silence(Site.ROBOT, guardian.silent) if _silent(guardian) else ""


def _silent(guardian: Guardian) -> bool:
    return guardian.in_charge and not guardian.outputs_flow


def _unheard(guardian: Guardian) -> str:
    """Returns why a driver that is inhibited, perhaps by an earlier life of ours, stays so; "" for no reason."""
    if guardian.inhibit_said is False or not guardian.in_charge or guardian.outputs_heard:
        return ""
    return "No message of the robot's rated outputs has been seen since"


def wanted(guardian: Guardian, node: Node) -> State:
    """The state that a node is to be in."""
    active = not node.spec.duplicated or guardian.acting or node.spec.hot
    return State.ACTIVE if active else State.INACTIVE


def _each(guardian: Guardian, name: str, change: object) -> Guardian:
    assert callable(change)
    return replace(guardian, nodes=tuple(change(n) if n.spec.name == name else n for n in guardian.nodes))


def _act(guardian: Guardian, event: Acting, now_s: float) -> Guardian:
    in_charge = event.acting and event.in_charge
    if event.acting != guardian.acting:
        nodes = tuple(replace(n, retry_s=0.0, gave_up="", failing_since_s=None, failures=0) for n in guardian.nodes)
        guardian = replace(guardian, acting=event.acting, acting_since_s=now_s, nodes=nodes)
    if in_charge != guardian.in_charge:
        guardian = replace(guardian, in_charge=in_charge, fault_since_s=None)
    return replace(
        guardian,
        outputs_flow=event.outputs_flow,
        outputs_heard=event.outputs_heard,
        silent=event.silent,
        stop=event.stop,
    )


def _observe(node: Node, state: State, now_s: float, commands: list[Command]) -> Node:
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


def _look(node: Node, seen: bool, now_s: float, commands: list[Command]) -> Node:
    """Takes what a look at the graph found of a node without a lifecycle."""
    if node.spec.lifecycle:
        return node
    unseen = 0 if seen else node.unseen + 1
    if 0 < unseen < UNSEEN_LOOKS and node.state_s is not None:
        return replace(node, unseen=unseen)
    return replace(_observe(node, State.ACTIVE if seen else State.UNKNOWN, now_s, commands), unseen=unseen)


def _answer(node: Node, event: Answered, now_s: float, commands: list[Command]) -> Node:
    if node.asked is not event.transition:
        return node
    if event.success:
        return _healthy(_observe(node, GOAL[event.transition], now_s, commands))
    return _failed(node, f"{event.transition.value} was refused", now_s, commands)


def _expire(node: Node, flows: bool, now_s: float, commands: list[Command]) -> Node:
    """Ends calls at their deadlines. A transition without an answer is followed by a read, not by a retry."""
    if node.reading_until_s is not None and now_s >= node.reading_until_s:
        if flows and node.state is State.ACTIVE:  # a long callback answers nobody; what it publishes shows its life
            return replace(node, reading_until_s=None, read_due_s=now_s + UNKNOWN_PERIOD_S)
        node = _observe(node, State.UNKNOWN, now_s, commands)
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


def _advance(guardian: Guardian, now_s: float, commands: list[Command]) -> Guardian:
    """Asks for what is due: bring-up in order, sleep in reverse, reads in between.

    A CORE node waits for CORE nodes only: without it the robot does not move, and no other node is worth that.
    """
    nodes = {n.spec.name: n for n in guardian.nodes}
    waits = waits_core = False  # an earlier node is still on its way up: later ones wait for it
    for node in guardian.nodes:
        if node.spec.lifecycle and wanted(guardian, node) is State.ACTIVE:
            if not (waits_core if node.spec.core else waits):
                nodes[node.spec.name] = _ask(node, _upwards(node), now_s, commands)
            waits = waits or _rises(node)
            waits_core = waits_core or (node.spec.core and _rises(node))
    up = waits
    waits = False
    for node in reversed(guardian.nodes):
        if node.spec.lifecycle and wanted(guardian, node) is State.INACTIVE:
            sleepy = node.state is State.ACTIVE
            if sleepy and not waits:
                nodes[node.spec.name] = _ask(node, Transition.DEACTIVATE, now_s, commands)
            elif node.state is State.UNCONFIGURED and not up:
                nodes[node.spec.name] = _ask(node, Transition.CONFIGURE, now_s, commands)
            waits = waits or (sleepy and not node.gave_up and node.failures == 0)
    for name, node in nodes.items():
        if node.spec.lifecycle and node.reading_until_s is None and now_s >= node.read_due_s:
            commands.append(GetState(name, READ_DEADLINE_S))
            nodes[name] = replace(node, reading_until_s=now_s + READ_DEADLINE_S)
    return _with(guardian, tuple(nodes.values()))


def _with(guardian: Guardian, nodes: tuple[Node, ...]) -> Guardian:
    """Returns the guardian with these nodes: the same one when each of them is the same."""
    same = all(map(is_, nodes, guardian.nodes))
    return guardian if same else replace(guardian, nodes=nodes)


def due_s(guardian: Guardian, now_s: float) -> float:
    """Returns before when a Tick changes nothing, once a Tick at `now_s` has changed nothing; infinite for never."""
    times_s = [guardian.inhibit_due_s]
    if guardian.fault_since_s is not None:
        times_s.append(guardian.fault_since_s + guardian.grace_s)
    for node in guardian.nodes:
        times_s += (node.retry_s, node.read_due_s)
        if node.reading_until_s is not None:
            times_s.append(node.reading_until_s)
        if node.asked:
            times_s.append(node.asked_until_s)
    return min([at_s for at_s in times_s if at_s > now_s], default=float("inf"))


def _rises(node: Node) -> bool:
    """Returns whether a node is on its way up for the first time; a dead or refusing one holds up nobody."""
    unread = node.state_s is None
    return unread or (node.state in (State.UNCONFIGURED, State.INACTIVE) and node.failures == 0 and not node.gave_up)


def degraded(guardian: Guardian) -> tuple[str, ...]:
    """Returns the nodes, none of them CORE, that should be Active and are dead, refuse, are unseen or were given up."""
    return tuple(
        n.spec.name
        for n in guardian.nodes
        if not n.spec.core and wanted(guardian, n) is State.ACTIVE
        and n.state is not State.ACTIVE and not _rises(n)
    )  # fmt: skip


def _upwards(node: Node) -> Transition | None:
    if node.state is State.UNCONFIGURED:
        return Transition.CONFIGURE
    return Transition.ACTIVATE if node.state is State.INACTIVE else None


def _ask(node: Node, transition: Transition | None, now_s: float, commands: list[Command]) -> Node:
    if transition is None or node.asked is not None or node.gave_up or now_s < node.retry_s:
        return node
    commands.append(ChangeState(node.spec.name, transition, TRANSITION_DEADLINE_S))
    return replace(node, asked=transition, asked_until_s=now_s + TRANSITION_DEADLINE_S)


def _core_rule(guardian: Guardian, now_s: float, commands: list[Command]) -> Guardian:
    """Inhibits the driver when a CORE node that should act does not, after the grace; releases it when healthy."""
    if not guardian.has_driver:
        return guardian
    fault = core_fault(guardian) or _unheard(guardian)
    if not fault:
        guardian = guardian if guardian.fault_since_s is None else replace(guardian, fault_since_s=None)
    elif guardian.fault_since_s is None:
        guardian = replace(guardian, fault_since_s=now_s)
    since_s = guardian.fault_since_s
    # Once inhibited, stay so until healthy: a second fault in a row earns no second grace. Silence earns none at all:
    # it is judged only after the nodes had their time.
    inhibit = since_s is not None and (
        now_s - since_s >= guardian.grace_s or bool(guardian.inhibit_said) or _silent(guardian) or bool(guardian.stop)
    )
    if fault and not inhibit and guardian.inhibit_said is None:
        return guardian  # an earlier incarnation of us may have inhibited the driver, and for a reason
    # The first word is said in any case, once all is well: see above.
    repeat = (inhibit or guardian.inhibited is not inhibit) and now_s >= guardian.inhibit_due_s
    if guardian.inhibit_said is not inhibit or repeat:
        commands.append(Inhibit(inhibit, fault or "All CORE nodes act"))
        return replace(guardian, inhibit_said=inhibit, inhibit_due_s=now_s + INHIBIT_PERIOD_S)
    return guardian
