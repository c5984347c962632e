"""The shell of either relay: entities, bus and clock around the core's relay process.

Two threads: ROS (main; all of the core's calls are made there) and bus. The bus thread passes what it reads to the
other one and wakes it.
"""

from __future__ import annotations

import logging
import select
import threading
from collections import Counter, deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

from robot_offload_agent.relay import cdr
from robot_offload_agent.relay.entities import ActionClient, ActionServer, ServiceClient, ServiceServer
from robot_offload_agent.relay.inherited import Inherited
from robot_offload_agent.ros import context
from robot_offload_agent.ros.native import NativeError
from robot_offload_agent.ros.raw_services import Loop
from robot_offload_agent.runtime import realtime
from robot_offload_agent.runtime.beacon import Beacon
from robot_offload_agent.runtime.bus import Bus
from robot_offload_agent.runtime.clock import now_s, wall_ns
from robot_offload_agent.runtime.guard import Guard
from robot_offload_agent.settings.parameters import Configuration
from robot_offload_agent.settings.served import private_name
from robot_offload_core.relay.goals.ports import CancelCode, Face, GoalEntry, GoalStatus
from robot_offload_core.relay.process import RelayPlan, RelayProcess
from robot_offload_core.words.messages import RelayStatus

log = logging.getLogger(__name__)

GRAPH_LOOK_S = 1.0
GRAPH_LOOK_SOON_S = 0.1
"""Interval of the looks at the graph: normally, and while a called server has not been seen."""
HURRIED_S = 3.0
"""After a start the graph is looked at often for this time: goals of a predecessor wait for their servers."""
BUS_S = 0.5
"""The bus thread gives its sign of life at least this often."""


class RelayShell:
    """Base of both sides.

    Attributes:
        process: the core's relay process, set by the subclass after `build`: it may answer and call at once.
        problems: of the shell, for diagnostics.
        succeeds: a predecessor has left goals or calls.
    """

    process: RelayProcess

    def __init__(self, configuration: Configuration, bus: Bus) -> None:
        self.configuration, self.bus = configuration, bus
        self.side = configuration["side"]
        self.beacon = Beacon(bus, "ros", "bus")
        self.guard = Guard(context.is_up)
        context.init(configuration)
        self.node = context.make_node(configuration, f"offload_relay_{self.side}")
        self.loop = Loop(self.node)
        self.inherited = Inherited(self.node)
        self.inbox: deque[object] = deque()
        self.after: deque[Callable[[], None]] = deque()
        self.failures: Counter[str] = Counter()
        self.problems: dict[str, tuple[str, str]] = {}
        self.service_servers: dict[tuple[Face, str], ServiceServer] = {}
        self.action_servers: dict[tuple[Face, str], ActionServer] = {}
        self.service_clients: dict[tuple[Face, str], ServiceClient] = {}
        self.action_clients: dict[tuple[Face, str], ActionClient] = {}
        self.look_due_s, self.hurried_s = 0.0, now_s() + HURRIED_S
        self.succeeds = False

    # -- building -----------------------------------------------------------------------------------------------------

    def build(self, plan: RelayPlan) -> None:
        """Make the entities; raise StartError naming a type that is missing."""
        public, side = self.side == "robot", self.side
        for service in plan.services:
            if public:
                self._serve_service(Face.PUBLIC, service.name, service.name, service.type)
            if not service.pooled and not (public and service.of_cloud):
                self._call_service(Face.GROUP, service.name, private_name(side, service.name), service.type)
        for name, kind, of_cloud in [(a.name, a.type, a.of_cloud) for a in plan.actions]:
            if public:
                self._serve_action(Face.PUBLIC, name, name, kind)
            if not (public and of_cloud):
                self._call_action(Face.GROUP, name, private_name(side, name), kind)
        self._build_used(plan)

    def _build_used(self, plan: RelayPlan) -> None:
        public, side = self.side == "robot", self.side
        for service in plan.used_services:
            self._serve_service(Face.GROUP, service.name, private_name(side, service.name), service.type)
            if public:
                self._call_service(Face.PUBLIC, service.name, service.name, service.type)
        for action in plan.used_actions:
            self._serve_action(Face.GROUP, action.name, private_name(side, action.name), action.type)
            if public:
                self._call_action(Face.PUBLIC, action.name, action.name, action.type)

    def _serve_service(self, face: Face, name: str, full: str, kind: str) -> None:
        self.service_servers[face, name] = ServiceServer(self, face, name, full, kind)

    def _serve_action(self, face: Face, name: str, full: str, kind: str) -> None:
        self.action_servers[face, name] = ActionServer(self, face, name, full, kind)

    def _call_service(self, face: Face, name: str, full: str, kind: str) -> None:
        self.service_clients[face, name] = ServiceClient(self, full, kind)

    def _call_action(self, face: Face, name: str, full: str, kind: str) -> None:
        self.action_clients[face, name] = ActionClient(self, face, name, full, kind)

    def later(self, act: Callable[[], None]) -> None:
        """Call a function after the present call into the relay has returned."""
        self.after.append(act)

    # -- running ------------------------------------------------------------------------------------------------------

    def run(self) -> None:
        """Run until it is ended."""
        threading.Thread(target=self.serve_bus, name="bus", daemon=True).start()
        self.loop.run(self.turn, self.guarded)

    def serve_bus(self) -> None:
        """Read messages of the other processes."""
        while True:
            select.select([self.bus], [], [], BUS_S)
            self.beacon.sign("bus")
            found = False
            while (message := self.bus.receive()) is not None:
                self.inbox.append(message)
                found = True
            if found:
                self.loop.wake()

    def guarded(self, act: Callable[[], None]) -> None:
        """Call the function that handles one message; count what it raises."""
        with self.guard:
            act()

    def turn(self) -> float:
        """Handle what was read and what is due; return when to turn again."""
        self.beacon.sign("ros")
        while self.inbox:
            self.guarded(partial(self.process.handle, self.inbox.popleft()))
        while self.after:
            self.guarded(self.after.popleft())
        now = now_s()
        if now >= self.look_due_s:
            complete = self.look()
            self.look_due_s = now + (GRAPH_LOOK_S if complete and now > self.hurried_s else GRAPH_LOOK_SOON_S)
        inherited_due_s = self.inherited.turn()
        self.process.turn()
        return min(self.process.due_s, self.look_due_s, inherited_due_s)

    def look(self) -> bool:
        """Report the servers in the graph; return whether those of the group are all there.

        A successor waits until all are found: a server that it had found and lost would have forgotten its goals.
        """
        clients: dict[tuple[Face, str], ServiceClient | ActionClient] = {**self.service_clients, **self.action_clients}
        seen = [(face, name, client.endpoints()) for (face, name), client in clients.items()]
        complete = all(endpoints for face, _, endpoints in seen if face is Face.GROUP)
        if complete or not self.succeeds or now_s() > self.hurried_s:
            self.process.servers_seen([server for server in seen if server[2]])
        return complete

    # -- what the core's process needs: time, messages ---------------------------------------------------------------

    def now_s(self) -> float:
        """Return the steady clock, seconds."""
        return now_s()

    def wall_ns(self) -> int:
        """Return the system clock, nanoseconds."""
        return wall_ns()

    def send(self, to: str, message: object) -> bool:
        """Send a message to another process of this agent; the shell adds its own part to a status."""
        if isinstance(message, RelayStatus) and message.counters:
            own = {f"{name}.failures": count for name, count in self.failures.items()}
            own["garbage.relay"] = self.bus.garbage + self.guard.count
            own["inherited.lost"] = self.inherited.lost
            problems = (*message.problems, *self.problems.values())
            message = replace(message, problems=problems, counters=(*message.counters, *sorted(own.items())))
        return self.bus.send(to, message)

    def warn(self, message: str) -> None:
        """Log a warning."""
        log.warning("%s", message)

    # -- as a client ---------------------------------------------------------------------------------------------------

    def offer(self, face: Face, action: str, payload: bytes) -> None:
        """Call `send_goal`."""
        self.tried(action, partial(self.action_clients[face, action].offer, payload))

    def cancel(self, face: Face, action: str, goal_id: bytes) -> None:
        """Call `cancel_goal`."""
        self.tried(action, partial(self.action_clients[face, action].cancel, goal_id))

    def ask_result(self, face: Face, action: str, goal_id: bytes) -> None:
        """Call `get_result`."""
        self.tried(action, partial(self.action_clients[face, action].ask_result, goal_id))

    def call(self, face: Face, service: str, key: int, payload: bytes) -> None:
        """Call a service."""
        self.tried(service, partial(self.service_clients[face, service].call, key, payload))

    def forget_call(self, key: int) -> None:
        """Drop a call."""
        for client in self.service_clients.values():
            client.forget(key)

    # -- as a server ---------------------------------------------------------------------------------------------------

    def answer_goal(self, face: Face, action: str, caller: bytes, accepted: bool, stamp_ns: int) -> None:
        """Answer a `send_goal`."""
        server = self.action_servers[face, action].send
        self.tried(action, partial(server.answer, caller, cdr.goal_response(accepted, stamp_ns)))

    def answer_cancel(
        self, face: Face, action: str, caller: bytes, code: CancelCode, goals: Sequence[GoalEntry]
    ) -> None:
        """Answer a `cancel_goal`."""
        server = self.action_servers[face, action].cancel
        self.tried(action, partial(server.answer, caller, cdr.cancel_response(code, goals)))

    def answer_result(self, face: Face, action: str, caller: bytes, status: GoalStatus, payload: bytes) -> None:
        """Answer a `get_result`."""
        self.tried(action, partial(self.action_servers[face, action].answer_result, caller, status, payload))

    def publish_feedback(self, face: Face, action: str, payload: bytes) -> None:
        """Publish a feedback message."""
        self.action_servers[face, action].feedback.publish(payload)

    def publish_status(self, face: Face, action: str, goals: Sequence[GoalEntry]) -> None:
        """Publish the status of an action's goals."""
        self.action_servers[face, action].publish_status(goals)

    def answer_call(self, face: Face, service: str, caller: bytes, payload: bytes) -> None:
        """Answer a service call."""
        self.tried(service, partial(self.service_servers[face, service].server.answer, caller, payload))

    def fail_call(self, face: Face, service: str, caller: bytes, reason: str, message: str) -> None:
        """Answer a call that failed if its response can state that; otherwise the caller gets no answer."""
        server = self.service_servers[face, service]
        response = server.failure(message)
        log.warning("A call of %s failed: %s reason=%s", service, message, reason)
        if response is None:
            server.server.drop(caller)
        else:
            self.tried(service, partial(server.server.answer, caller, response))

    def tried(self, name: str, act: Callable[[], None]) -> None:
        """Do what the middleware may refuse; count refusals by name and log the first of each."""
        try:
            act()
        except NativeError as error:
            self.failures[name] += 1
            if self.failures[name] == 1:
                log.warning("%s: %s; further failures are only counted", name, error)


def start(configuration: Configuration, make: Callable[[Configuration, Bus, RelayPlan], RelayShell]) -> None:
    """Run the process; raise StartError for a type that is missing."""
    plan = configuration.relay_plan()
    assert plan is not None, "a relay without a name to serve or use"
    shell = make(configuration, Bus(configuration.runtime_dir, "relay"), plan)
    realtime.request(configuration["realtime"], realtime.DEFAULT_PRIORITY)
    shell.run()
