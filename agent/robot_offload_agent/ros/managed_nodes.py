"""Carries out the commands of the guardian core: lifecycle services of the managed nodes and the driver's inhibit."""

from __future__ import annotations

import difflib
import logging
import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from lifecycle_msgs.msg import State as StateMsg
from lifecycle_msgs.msg import Transition as TransitionMsg
from lifecycle_msgs.msg import TransitionEvent
from lifecycle_msgs.srv import ChangeState, GetState
from rclpy.node import Node
from std_srvs.srv import SetBool

from robot_offload_agent.ros.undeclared import Declared, Undeclared
from robot_offload_agent.runtime.clock import now_s
from robot_offload_agent.settings.parameters import Configuration
from robot_offload_core.control.nodes import guardians, managed_nodes
from robot_offload_core.control.nodes.managed_nodes import Transition
from robot_offload_core.fence.token import Site
from robot_offload_core.words.events import assert_never
from robot_offload_core.words.lifecycle import State
from robot_offload_core.words.settings import NodeSpec

log = logging.getLogger(__name__)

STATES = {
    StateMsg.PRIMARY_STATE_UNCONFIGURED: State.UNCONFIGURED,
    StateMsg.PRIMARY_STATE_INACTIVE: State.INACTIVE,
    StateMsg.PRIMARY_STATE_ACTIVE: State.ACTIVE,
    StateMsg.PRIMARY_STATE_FINALIZED: State.FINALIZED,
}
TRANSITIONS = {
    Transition.CONFIGURE: TransitionMsg.TRANSITION_CONFIGURE,
    Transition.ACTIVATE: TransitionMsg.TRANSITION_ACTIVATE,
    Transition.DEACTIVATE: TransitionMsg.TRANSITION_DEACTIVATE,
}
KEPT_INHIBITS = 8
"""Most unanswered requests to the driver; rclpy would keep one to a dead driver for ever."""
UNANSWERED_S = 5.0
"""A request without an answer for this long was lost; Fast DDS repeats one that did not arrive after 3 s. Sooner, the
node may still carry it out, and a second one behind it. A node of rclpy that is asked for a transition that its state
does not have raises an error: its process ends."""
NAME_LIKENESS = 0.75
"""Likeness by difflib's measure above which a name is taken for a typing error: `detecter` for `detector` has 0.9."""


def ros_name(side: Site, spec: NodeSpec) -> str:
    """Return the node's ROS name on a side: replicas in the cloud carry the prefix `remote_`."""
    head, slash, last = spec.name.rpartition("/")
    return f"{head}{slash}remote_{last}" if side is Site.CLOUD and spec.duplicated else spec.name


def full_name(configuration: Configuration, name: str) -> str:
    """Return a node's full ROS name on this side from its name in the resource; the node need not be managed."""
    known = {spec.name: spec for spec in configuration.node_specs()}
    found = ros_name(configuration.side, known[name]) if name in known else name
    return found if found.startswith("/") else f"{configuration['namespace'].rstrip('/')}/{found}"


@dataclass(frozen=True)
class Unanswered:
    """The newest request of a transition.

    Attributes:
        transition: that was asked for.
        call: done when it was answered.
        since_s: when it was sent, steady clock.
    """

    transition: Transition
    call: Any
    since_s: float


class ManagedNodes:
    """Service clients of one side's managed nodes. Calls are made on the deciding thread and answered on ROS's."""

    def __init__(self, configuration: Configuration, node: Node, post: Callable[[guardians.Event], None]) -> None:
        self.configuration = configuration
        self.node = node
        self.post = post
        self.declared = Declared(configuration, node)
        self.names: dict[str, str] = {}
        self.change: dict[str, Any] = {}
        self.read: dict[str, Any] = {}
        self.pending: dict[Any, Any] = {}  # client -> its newest call
        self.unanswered: dict[str, Unanswered] = {}
        self.known: dict[str, tuple[float, State]] = {}  # when a node last reported a state, and which
        self.inhibits: deque[Any] = deque()
        self.watched: list[Any] = []
        self.managers: dict[str, set[str]] = {}
        self.strangers: dict[str, tuple[str, str] | None] = {}
        self.plain: dict[str, tuple[str, tuple[str, ...]]] = {}
        for spec in configuration.node_specs():
            if spec.lifecycle:
                self._watch(spec)
            else:
                self.plain[spec.name] = self._full_name(spec), spec.names
        service = configuration["inhibit_service"]
        self.inhibit = None
        if configuration.side is Site.ROBOT and service:
            self.inhibit = node.create_client(SetBool, service)

    def _watch(self, spec: NodeSpec) -> None:
        name, full = spec.name, self._full_name(spec)
        self.names[name] = full
        self.change[name] = self.node.create_client(ChangeState, f"{full}/change_state")
        self.read[name] = self.node.create_client(GetState, f"{full}/get_state")
        on_event = partial(self._event, name)
        self.watched.append(self.node.create_subscription(TransitionEvent, f"{full}/transition_event", on_event, 10))

    def _full_name(self, spec: NodeSpec) -> str:
        full = ros_name(self.configuration.side, spec)
        return full if full.startswith("/") else f"{self.configuration['namespace'].rstrip('/')}/{full}"

    def duplicated_names(self) -> dict[str, str]:
        """Return the full ROS name of each duplicated node on this side."""
        specs = (spec for spec in self.configuration.node_specs() if spec.duplicated)
        return {spec.name: self._full_name(spec) for spec in specs}

    def missing_plain(self) -> dict[str, str]:
        """Return, for each node without a lifecycle, what of it is missing in the graph; "" if nothing is."""
        found = {}
        for name, (full, names) in self.plain.items():
            namespace, _, short = full.rpartition("/")
            try:
                seen = {topic for topic, _ in self.node.get_publisher_names_and_types_by_node(short, namespace or "/")}
                seen |= {topic for topic, _ in self.node.get_service_names_and_types_by_node(short, namespace or "/")}
            except RuntimeError:  # rclpy raises this for a node that is not in the graph
                found[name] = f"{full} is not in the graph{self._alike(full)}"
                continue
            absent = [topic for topic in names if topic not in seen]
            found[name] = f"{full} does not publish {', '.join(absent)}; remap its output" if absent else ""
        return found

    def _alike(self, full: str) -> str:
        """Return the name that was probably meant, as a question; "" if no name is similar."""
        running = {f"{space.rstrip('/')}/{name}" for name, space in self.node.get_node_names_and_namespaces()}
        close = difflib.get_close_matches(full, running - set(self.names.values()), 1, NAME_LIKENESS)
        return f"; did you mean {close[0]}?" if close else ""

    def _event(self, name: str, message: TransitionEvent) -> None:
        state = STATES.get(message.goal_state.id)
        if state is not None:
            self._know(name, state)
            self.post(managed_nodes.Observed(name, state))

    def carry_out(self, command: managed_nodes.Command) -> None:
        """Carry out one command of the core; ignore news of nodes, which are only for the log."""
        match command:
            case managed_nodes.ChangeState():
                self._change(command.name, command.transition)
            case managed_nodes.GetState():
                self._read(command.name)
            case managed_nodes.Inhibit():
                self._inhibit(command)
            case managed_nodes.NodeNews():
                pass
            case _:
                assert_never(command)

    def _change(self, name: str, transition: Transition) -> None:
        client = self.change[name]
        if not client.service_is_ready():
            self.unanswered.pop(name, None)  # its process has gone, and the request with it
            return  # the core's deadline turns this into a read
        before = self.unanswered.get(name)
        if before is not None and not before.call.done() and now_s() < before.since_s + UNANSWERED_S:
            return  # the node may still carry it out, and a second one then ends its process
        request = ChangeState.Request()
        request.transition.id = TRANSITIONS[transition]

        def done(future: Any) -> None:
            response = future.result()
            if response is not None:
                if response.success:
                    self._know(name, managed_nodes.GOAL[transition])
                self.post(managed_nodes.Answered(name, transition, response.success))

        self.unanswered[name] = Unanswered(transition, self._call(client, request, done), now_s())

    def _read(self, name: str) -> None:
        client = self.read[name]
        if not client.service_is_ready():
            self.post(managed_nodes.Observed(name, State.UNKNOWN))
            return
        asked_s = now_s()

        def done(future: Any) -> None:
            response = future.result()
            state = STATES.get(response.current_state.id) if response is not None else None
            known_s, known = self.known.get(name, (-math.inf, None))
            if known_s >= asked_s:
                state = known  # the node has changed since it was asked
            if state is State.UNCONFIGURED:
                self._forget_unless_configuring(name)
            if state is not None:  # in transition: the event reports its end
                self.post(managed_nodes.Observed(name, state))

        self._call(client, GetState.Request(), done)

    def _know(self, name: str, state: State) -> None:
        """Note a state that the node has reported by itself or by an answer: it is newer than reads under way."""
        self.known[name] = now_s(), state

    def _forget_unless_configuring(self, name: str) -> None:
        """Wait no longer for a process that was started anew; one that is to be configured may still do that."""
        before = self.unanswered.get(name)
        if before is not None and before.transition is not Transition.CONFIGURE:
            del self.unanswered[name]

    def _inhibit(self, command: managed_nodes.Inhibit) -> None:
        assert self.inhibit is not None
        if not self.inhibit.service_is_ready():
            return  # said again until it is confirmed
        if command.inhibit:
            log.warning("Inhibiting the driver: %s", command.reason)
        else:
            log.info("Releasing the driver: %s", command.reason)

        def done(future: Any) -> None:
            response = future.result()
            if response is not None and response.success:
                self.post(guardians.InhibitAnswered(command.inhibit))

        # Earlier calls count, too: a driver with several threads may serve one of them last.
        while len(self.inhibits) >= KEPT_INHIBITS:
            self.inhibit.remove_pending_request(self.inhibits.popleft())
        future = self.inhibit.call_async(SetBool.Request(data=command.inhibit))
        self.inhibits.append(future)
        future.add_done_callback(done)

    def _call(self, client: Any, request: Any, done: Callable[[Any], None]) -> Any:
        """Return the future of a call; forget the call before, because rclpy keeps an unanswered one for ever."""
        before = self.pending.get(client)
        if before is not None:
            client.remove_pending_request(before)
        future = self.pending[client] = client.call_async(request)
        future.add_done_callback(done)
        return future

    def other_managers(self) -> dict[str, str]:
        """Return, for each node, the other program that manages it as well; "" for none."""
        services = {f"{full}/change_state": name for name, full in self.names.items()}
        found: dict[str, set[str]] = {name: set() for name in self.names}
        for other, namespace in self.node.get_node_names_and_namespaces():
            if (other, namespace) == (self.node.get_name(), self.node.get_namespace()):
                continue
            try:
                clients = self.node.get_client_names_and_types_by_node(other, namespace)
            except RuntimeError:  # rclpy raises this for a node that has gone
                continue
            for service, _ in clients:
                if service in services:
                    found[services[service]].add(f"{namespace.rstrip('/')}/{other}")
        lasting = {name: ", ".join(sorted(who & self.managers.get(name, set()))) for name, who in found.items()}
        self.managers = found  # a call by hand (`ros2 lifecycle set`) is gone at the next look
        return lasting

    def strange(self) -> dict[str, tuple[str, str] | None]:
        """Return, for each node, (reason, message) if what runs differs from its declaration."""
        found: dict[str, tuple[str, str] | None] = {}
        running = {f"{space.rstrip('/')}/{name}" for name, space in self.node.get_node_names_and_namespaces()}
        for name, full in self.names.items():
            found[name] = None
            if self.read[name].service_is_ready():
                continue
            if full in running:
                message = f"{full} runs, and has no lifecycle: write `lifecycle: false`, or make it a managed node"
                found[name] = ("NotLifecycle", message)
            elif close := difflib.get_close_matches(full, running - set(self.names.values()), 1, NAME_LIKENESS):
                message = f"{full} does not run; {close[0]} does: give the node the name that it has in the graph"
                found[name] = ("NodeMissing", message)
        lasting = {name: problem if problem == self.strangers.get(name) else None for name, problem in found.items()}
        self.strangers = found  # a node that starts offers its services a moment after its name
        return lasting

    def undeclared(self) -> dict[str, Undeclared]:
        """Return, for each duplicated node that is seen, what it does beyond its declaration."""
        names = [spec.name for spec in self.configuration.node_specs() if spec.duplicated]
        return self.declared.compare({name: self.names.get(name) or self.plain[name][0] for name in names})
