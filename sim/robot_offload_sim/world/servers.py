"""The user's servers of one side: actions and services of lifecycle nodes, with what makes them hard to hand over.

An action server takes each goal id once. As in Nav2, an Inactive server rejects goals, a deactivated one aborts running
goals, and one with a single goal aborts the older goal when it takes another.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from robot_offload_core.fence.token import Site
from robot_offload_core.relay.goals.ports import ALL_GOALS, CancelCode, Face, GoalStatus
from robot_offload_core.relay.goals.wire_ids import GOAL_ID, goal_id_of
from robot_offload_core.words.lifecycle import State
from robot_offload_sim.world.nodes import Node
from robot_offload_sim.world.world import Process, World

ANSWER_S = 0.002
LOOK_S = 0.02
FEEDBACK_S = 0.05
Done = Callable[..., None]


def goal_words(number: int) -> bytes:
    """Return a SendGoal request of a client's goal; its number is after the id, where it is not read."""
    return bytes(4) + number.to_bytes(16, "big") + number.to_bytes(8, "big")


def number_of(payload: bytes) -> int:
    """Return the number of the client's goal in a request, even if the id was changed."""
    return int.from_bytes(payload[GOAL_ID.stop :][:8], "big")


@dataclass
class Traits:
    """How a server behaves; faults and stories change it.

    Attributes:
        takes_s: how long a goal is executed; inf: until it is cancelled.
        accept_s: delay before it answers an offer.
        single: whether it takes one goal at a time.
        rejects, deaf, mute: active faults that refuse goals, ignore cancels, leave calls and offers unanswered.
        ends: status with which a goal ends.
        call_s: how long a call is executed.
    """

    takes_s: float = float("inf")
    accept_s: float = 0.0
    single: bool = False
    rejects: int = 0
    deaf: int = 0
    mute: int = 0
    ends: GoalStatus = GoalStatus.SUCCEEDED
    call_s: float = 0.005


@dataclass
class Execution:
    """A goal at a server. `asked`: true time at which its end was requested."""

    attempt: bytes
    number: int
    action: str
    began_s: float
    status: GoalStatus = GoalStatus.EXECUTING
    waiting: list[Done] = field(default_factory=list)
    asked_s: float | None = None
    ticks: int = 0


class Servers:
    """All servers of one side.

    Attributes:
        nodes: resource name -> node.
        of: name of a server -> name of its node.
        executions: by attempt, within the present life of their node.
        called: (service, payload, true time) of each call.
        began: each attempt ever accepted, in order.
    """

    def __init__(self, world: World, site: Site, nodes: dict[str, Node], of: dict[str, str]) -> None:
        self.world = world
        self.site = site
        self.nodes = nodes
        self.of = of
        self.traits: dict[str, Traits] = {name: Traits() for name in of}
        self.executions: dict[bytes, Execution] = {}
        self.lives: dict[str, int] = {}
        self.called: list[tuple[str, bytes, float]] = []
        self.began: list[Execution] = []
        self.feed: Callable[[str, bytes], None] = lambda _name, _payload: None
        self.watch: Callable[[Execution], None] = lambda _execution: None
        self.heard_call: Callable[[str, bytes], None] = lambda _service, _payload: None

    def start(self) -> None:
        """Begin to advance what is executed."""
        self.world.after(LOOK_S, self._look)

    def seen(self) -> list[tuple[Face, str, str]]:
        """Return the servers in the graph of this side; those of a restarted node differ from the earlier ones."""
        alive = [(name, self.nodes[node]) for name, node in self.of.items() if self.nodes[node].alive]
        return [(Face.GROUP, name, str(node.life)) for name, node in alive]

    # -- actions ------------------------------------------------------------------------------------------------------

    def offer(self, client: Process, action: str, payload: bytes, done: Done) -> None:
        """Serve send_goal; `done(accepted)` happens at the client, unless the answer is lost."""
        delay_s = ANSWER_S + self.world.dice.random() * ANSWER_S + self.traits[action].accept_s
        self._node(action).post("offer", self._later, delay_s, self._offered, client, action, payload, done)

    def _later(self, delay_s: float, act: Done, *args: Any) -> None:
        self.world.after(delay_s, act, *args)

    def _offered(self, client: Process, action: str, payload: bytes, done: Done) -> None:
        node, traits, attempt = self._node(action), self.traits[action], goal_id_of(payload)
        assert attempt is not None
        if not node.running or traits.mute:
            return
        self._forget(action)
        accepted = node.state is State.ACTIVE and not traits.rejects and attempt not in self.executions
        if accepted:
            if traits.single:
                for other in self._running(action):
                    self._end(other, GoalStatus.ABORTED)
            execution = Execution(attempt, number_of(payload), action, self.world.now)
            self.executions[attempt] = execution
            self.began.append(execution)
            self.watch(execution)
        client.reply(node.name, f"{action}/send_goal", done, accepted)

    def cancel(self, client: Process, action: str, attempt: bytes, done: Done) -> None:
        """Serve cancel_goal for one goal."""
        self._node(action).post("cancel", self._later, ANSWER_S, self._cancelled, client, action, attempt, done)

    def _cancelled(self, client: Process, action: str, attempt: bytes, done: Done) -> None:
        node = self._node(action)
        if not node.running:
            return
        self._forget(action)
        if attempt == ALL_GOALS:
            for running in self._running(action):
                self._ask_to_end(running)
            client.reply(node.name, f"{action}/cancel_goal", done, CancelCode.NONE)
            return
        execution = self.executions.get(attempt)
        if execution is None:
            client.reply(node.name, f"{action}/cancel_goal", done, CancelCode.UNKNOWN_GOAL)
            return
        self._ask_to_end(execution)
        code = CancelCode.REJECTED if self.traits[action].deaf else CancelCode.NONE
        client.reply(node.name, f"{action}/cancel_goal", done, code)

    def _ask_to_end(self, execution: Execution) -> None:
        if execution.asked_s is None:
            execution.asked_s = self.world.now
        if not self.traits[execution.action].deaf and not execution.status.ended:
            self.world.after(LOOK_S, self._end, execution, GoalStatus.CANCELED)

    def ask_result(self, client: Process, action: str, attempt: bytes, done: Done) -> None:
        """Serve get_result: `done(status, payload)` at the client when the goal has ended; status 0: not known."""
        self._node(action).post("result", self._asked, client, action, attempt, done)

    def _asked(self, client: Process, action: str, attempt: bytes, done: Done) -> None:
        node = self._node(action)
        self._forget(action)
        execution = self.executions.get(attempt)

        def answer(status: GoalStatus) -> None:
            client.reply(node.name, f"{action}/get_result", done, status, self._result(execution, status))

        if execution is None:
            answer(GoalStatus.UNKNOWN)
        elif execution.status.ended:
            answer(execution.status)
        else:
            execution.waiting.append(answer)

    def _result(self, execution: Execution | None, status: GoalStatus) -> bytes:
        number = execution.number if execution is not None else 0
        site = b"r" if self.site is Site.ROBOT else b"c"
        return bytes(4) + bytes([status]) + site + number.to_bytes(8, "big")

    def _end(self, execution: Execution, status: GoalStatus) -> None:
        if execution.status.ended or self.executions.get(execution.attempt) is not execution:
            return
        execution.status = status
        self.world.note(f"{self.site.value} {execution.action} {execution.number} ends", status.name)
        for answer in execution.waiting:
            answer(status)
        execution.waiting.clear()

    def _running(self, action: str) -> list[Execution]:
        return [e for e in self.executions.values() if e.action == action and not e.status.ended]

    def busy(self) -> bool:
        """Return whether anything is executed now."""
        return any(not e.status.ended for e in self.executions.values())

    def running(self, number: int) -> list[Execution]:
        """Return what is executed of a client's goal now."""
        for action in self.of:
            self._forget(action)
        return [e for e in self.executions.values() if e.number == number and not e.status.ended]

    def _node(self, name: str) -> Node:
        return self.nodes[self.of[name]]

    def _forget(self, action: str) -> None:
        """Forget everything, like a restarted node."""
        node = self.of[action]
        life = self.nodes[node].life
        if self.lives.get(node, life) != life or not self.nodes[node].alive:
            self.executions = {a: e for a, e in self.executions.items() if self.of[e.action] != node}
        self.lives[node] = life

    def _look(self) -> None:
        """Let time pass for executions: feedback, end, abort at deactivated nodes."""
        self.world.after(LOOK_S, self._look)
        for action in self.of:
            self._forget(action)
        for execution in list(self.executions.values()):
            node = self._node(execution.action)
            if execution.status.ended or not node.running:
                continue
            traits = self.traits[execution.action]
            if node.state is not State.ACTIVE:
                self._end(execution, GoalStatus.ABORTED)
            elif self.world.now - execution.began_s >= traits.takes_s:
                self._end(execution, traits.ends)
            else:
                execution.ticks += 1
                site = b"r" if self.site is Site.ROBOT else b"c"
                words = bytes(4) + execution.attempt + execution.number.to_bytes(8, "big")
                self.feed(execution.action, words + site + execution.ticks.to_bytes(4, "big") + execution.attempt)

    # -- services -----------------------------------------------------------------------------------------------------

    def call(self, client: Process, service: str, payload: bytes, done: Done) -> None:
        """Serve a call: `done(payload)` at the client. An Inactive node answers too, but changes nothing."""
        self._node(service).post("call", self._later, ANSWER_S, self._execute, client, service, payload, done)

    def _execute(self, client: Process, service: str, payload: bytes, done: Done) -> None:
        node, traits = self._node(service), self.traits[service]
        if not node.running or traits.mute:
            return
        if node.state is State.ACTIVE:
            self.called.append((service, payload, self.world.now))
            self.heard_call(service, payload)
        words = payload + (b"r" if self.site is Site.ROBOT else b"c")
        self.world.after(traits.call_s, client.reply, node.name, service, done, words)
