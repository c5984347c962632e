"""Compare wanted and observed lifecycle states of one side's nodes: ordered transitions, and the CORE rule.

Nodes are activated in the order of the list and deactivated in reverse. A CORE node waits for CORE nodes only, and no
node waits for one that is dead or refuses. A single node is driven by managed_nodes.py.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from operator import is_

from robot_offload_core.control.nodes import managed_nodes
from robot_offload_core.control.nodes.managed_nodes import (
    READ_DEADLINE_S,
    Answered,
    Command,
    GetState,
    Inhibit,
    Node,
    Observed,
    Transition,
)
from robot_offload_core.fence.token import Site
from robot_offload_core.words.checks import require
from robot_offload_core.words.events import Acting, Tick, assert_never
from robot_offload_core.words.lifecycle import State
from robot_offload_core.words.reasons import silence
from robot_offload_core.words.replace import replace
from robot_offload_core.words.settings import NodeSpec

INHIBIT_PERIOD_S = 0.5
"""Period at which an inhibit request is repeated: until confirmed, and afterwards in case the driver restarted."""


@dataclass(frozen=True)
class Guardian:
    """State of one side's guardian.

    Attributes:
        nodes: in bring-up order.
        acting: this side is in charge or gets ready to be, so its duplicated nodes are to be Active.
        acting_since_s: since when.
        in_charge: this side is in charge; only then its duplicated CORE nodes matter to the driver.
        outputs_flow: the rated outputs of this side flow (judged by the collector).
        outputs_heard, silent, stop: see Acting.
        flowing: see Flowing.
        grace_s: how long a CORE node may be on its way to Active before the driver is inhibited.
        has_driver: there is an inhibit service (the robot's side).
        inhibited: last value confirmed by the driver; None before the first confirmation.
        inhibit_said: last value requested from the driver; None before the first request.
        inhibit_due_s: when to repeat the request.
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
class Flowing:
    """Level: the nodes whose rated outputs all flow. Such a node is not dead, even if too busy to answer a read."""

    names: tuple[str, ...]


@dataclass(frozen=True)
class Seen:
    """Level: the nodes without a lifecycle whose process and declared names are in the graph.

    They are Active from their start, on both sides. They cannot be asked for their state, so it is observed.
    """

    names: tuple[str, ...]


@dataclass(frozen=True)
class InhibitAnswered:
    """The driver confirmed an inhibit request."""

    inhibited: bool


Event = Observed | Answered | Acting | Flowing | Seen | InhibitAnswered | Tick


def start(specs: Iterable[NodeSpec], grace_s: float, has_driver: bool = False) -> Guardian:
    """Return a guardian that knows nothing yet."""
    return Guardian(tuple(Node(spec) for spec in specs), grace_s, has_driver)


def step(guardian: Guardian, event: Event, now_s: float) -> tuple[Guardian, list[Command]]:
    """Take one event and do everything that has become due."""
    commands: list[Command] = []
    before = guardian
    match event:
        case Observed(name, state):
            guardian = _each(guardian, name, lambda n: managed_nodes.observe(n, state, now_s, commands))
        case Answered():
            guardian = _each(guardian, event.name, lambda n: managed_nodes.answer(n, event, now_s, commands))
        case Acting():
            guardian = _act(guardian, event, now_s)
        case Flowing():
            guardian = replace(guardian, flowing=event.names)
        case Seen():
            nodes = tuple(managed_nodes.look(n, n.spec.name in event.names, now_s, commands) for n in guardian.nodes)
            guardian = replace(guardian, nodes=nodes)
        case InhibitAnswered():
            guardian = _answered(guardian, event.inhibited, now_s)
        case Tick():
            pass
        case _:
            assert_never(event)
    nodes = tuple(
        [managed_nodes.expire(node, node.spec.name in guardian.flowing, now_s, commands) for node in guardian.nodes]
    )
    guardian = _advance(_with(guardian, nodes), now_s, commands)
    guardian = _core_rule(guardian, now_s, commands)
    check(before, guardian, event)
    return guardian, commands


def check(before: Guardian, after: Guardian, event: Event) -> None:
    """Raise InvariantError if the step from `before` to `after` broke an invariant."""
    require(
        "guardian",
        event,
        (len(after.nodes) == len(before.nodes), "a node was lost"),
        (all(n.asked is None or n.spec.lifecycle for n in after.nodes), "a transition of a node without a lifecycle"),
        (after.acting or not after.in_charge, "in charge without acting"),
        (after.has_driver or after.inhibit_said is None, "a driver was inhibited that does not exist"),
    )


def is_ready(guardian: Guardian) -> bool:
    """Return whether all duplicated CORE nodes (all duplicated ones if none is CORE) are Active and stay so.

    A node without a lifecycle counts while it is seen.
    """
    duplicated = [n for n in guardian.nodes if n.spec.duplicated]
    core = [n for n in duplicated if n.spec.core] or duplicated
    return all(managed_nodes.stays_active(n) for n in core)


def core_fault(guardian: Guardian) -> str:
    """Return why the robot must not move now; "" if it may."""
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
    """Return why a driver stays inhibited, perhaps by an earlier process of ours; "" for no reason."""
    if guardian.inhibit_said is False or not guardian.in_charge or guardian.outputs_heard:
        return ""
    return "No message of the robot's rated outputs has been seen since"


def wanted(guardian: Guardian, node: Node) -> State:
    """Return the state that a node is to be in."""
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


def _advance(guardian: Guardian, now_s: float, commands: list[Command]) -> Guardian:
    """Ask for what is due: activate in order, deactivate in reverse, read in between.

    A CORE node waits for CORE nodes only: without it the robot cannot move, so no other node may delay it.
    """
    nodes = {n.spec.name: n for n in guardian.nodes}
    waits = waits_core = False  # an earlier node is still on its way up: later ones wait for it
    for node in guardian.nodes:
        if node.spec.lifecycle and wanted(guardian, node) is State.ACTIVE:
            if not (waits_core if node.spec.core else waits):
                nodes[node.spec.name] = managed_nodes.ask(node, managed_nodes.upwards(node), now_s, commands)
            waits = waits or managed_nodes.rises(node)
            waits_core = waits_core or (node.spec.core and managed_nodes.rises(node))
    up = waits
    waits = False
    for node in reversed(guardian.nodes):
        if node.spec.lifecycle and wanted(guardian, node) is State.INACTIVE:
            sleepy = node.state is State.ACTIVE
            if sleepy and not waits:
                nodes[node.spec.name] = managed_nodes.ask(node, Transition.DEACTIVATE, now_s, commands)
            elif node.state is State.UNCONFIGURED and not up:
                nodes[node.spec.name] = managed_nodes.ask(node, Transition.CONFIGURE, now_s, commands)
            waits = waits or (sleepy and not node.gave_up and node.failures == 0)
    for name, node in nodes.items():
        if node.spec.lifecycle and node.reading_until_s is None and now_s >= node.read_due_s:
            commands.append(GetState(name, READ_DEADLINE_S))
            nodes[name] = replace(node, reading_until_s=now_s + READ_DEADLINE_S)
    return _with(guardian, tuple(nodes.values()))


def _with(guardian: Guardian, nodes: tuple[Node, ...]) -> Guardian:
    """Return the guardian with these nodes; the same object if every node is the same."""
    same = all(map(is_, nodes, guardian.nodes))
    return guardian if same else replace(guardian, nodes=nodes)


def due_s(guardian: Guardian, now_s: float) -> float:
    """Return until when Ticks change nothing, after a Tick at `now_s` that changed nothing; infinite for always."""
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


def degraded(guardian: Guardian) -> tuple[str, ...]:
    """Return the nodes, none of them CORE, that should be Active and are dead, refuse, are unseen or were given up."""
    return tuple(
        n.spec.name
        for n in guardian.nodes
        if not n.spec.core and wanted(guardian, n) is State.ACTIVE
        and n.state is not State.ACTIVE and not managed_nodes.rises(n)
    )  # fmt: skip


def _answered(guardian: Guardian, inhibited: bool, now_s: float) -> Guardian:
    """Record what the driver confirmed; if it differs from our last request, repeat that.

    Two contrary requests within milliseconds can overtake each other in a driver with several threads.
    """
    if inhibited is guardian.inhibit_said:
        return replace(guardian, inhibited=inhibited)
    return replace(guardian, inhibited=inhibited, inhibit_due_s=now_s)


def _core_rule(guardian: Guardian, now_s: float, commands: list[Command]) -> Guardian:
    """Inhibit the driver if a CORE node that should act has not done so after the grace; release it when healthy."""
    if not guardian.has_driver:
        return guardian
    fault = core_fault(guardian) or _unheard(guardian)
    if not fault:
        guardian = guardian if guardian.fault_since_s is None else replace(guardian, fault_since_s=None)
    elif guardian.fault_since_s is None:
        guardian = replace(guardian, fault_since_s=now_s)
    since_s = guardian.fault_since_s
    # Once inhibited, stay so until healthy: a second fault in a row gets no second grace. Silence gets no grace at all,
    # as it is judged only after the nodes had their time.
    inhibit = since_s is not None and (
        now_s - since_s >= guardian.grace_s or bool(guardian.inhibit_said) or _silent(guardian) or bool(guardian.stop)
    )
    if fault and not inhibit and guardian.inhibit_said is None:
        return guardian  # an earlier incarnation of us may have inhibited the driver, and for a reason
    # The first request is sent in any case, once all is well: see above.
    repeat = (inhibit or guardian.inhibited is not inhibit) and now_s >= guardian.inhibit_due_s
    if guardian.inhibit_said is not inhibit or repeat:
        commands.append(Inhibit(inhibit, fault or "All CORE nodes act"))
        return replace(guardian, inhibit_said=inhibit, inhibit_due_s=now_s + INHIBIT_PERIOD_S)
    return guardian
