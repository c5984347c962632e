"""Lifecycle nodes of the user: free-running timers, no publishing inside a transition, and everything that can fail.

A transition may be slow, be refused, or succeed although its reply is lost; a node may hang (Active but silent) or
crash and come back Unconfigured as a new process.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

from robot_offload_core.control.nodes.managed_nodes import GOAL, Transition
from robot_offload_core.words.lifecycle import State
from robot_offload_core.words.settings import NodeSpec
from robot_offload_sim.world.scenario import Replica
from robot_offload_sim.world.world import Act, Host, Process, World

FROM = {
    Transition.CONFIGURE: State.UNCONFIGURED,
    Transition.ACTIVATE: State.INACTIVE,
    Transition.DEACTIVATE: State.ACTIVE,
}
RARE = 0.02
"""Share of service calls that meet a busy executor."""


class Message(NamedTuple):
    """What a replica publishes.

    Attributes:
        producer: the node.
        life: number of its starts; sequences of different lives are not comparable.
        sequence: increases by one with each message of that life.
        born_s: true time of publishing.
        size: bytes.
    """

    producer: str
    life: int
    sequence: int
    born_s: float
    size: int = 200


Sink = Callable[[str, int, Message], None]
"""(name of the node, index of the output, message)."""


class Node(Process):
    """One replica.

    Attributes:
        spec: as the guardian knows it.
        state: primary state.
        awake: whether its first process is Active already, because it was started before the agent.
        transition_s: longest normal transition.
        slow_s: delay that faults add to each transition.
        refusing, mute, hung: number of active faults of that kind.
        activations: increases with every change of state.
        active_s: when it last became Active, true time.
        occupied: returns whether there is a reason to publish; None: always.
        woken: called as the node becomes Active, like its `on_activate`; None: nothing.
    """

    def __init__(self, world: World, host: Host, spec: NodeSpec, replica: Replica, sink: Sink) -> None:
        super().__init__(world, host, f"{host.name}/{spec.name}")
        self.spec = spec
        self.replica = replica
        self.sink = sink
        self.awake = False
        self.transition_s = 0.015
        self.slow_s = 0.0
        self.refusing = 0
        self.mute = 0
        self.hung = 0
        self.state = State.UNCONFIGURED
        self.activations = 0
        self.occupied: Callable[[], bool] | None = None
        self.woken: Callable[[], None] | None = None
        self.active_s = -1.0
        self._sequence = 0
        self._busy_until_s = 0.0

    def boot(self) -> None:
        """Start a new process, Unconfigured; its timer runs from now on in every state, or from activation on."""
        awake = (self.awake and self.life == 1) or not self.spec.lifecycle
        self.state = State.ACTIVE if awake else State.UNCONFIGURED
        self._sequence = 0
        self._busy_until_s = self.world.now
        self.activations += 1
        if self.replica.output is not None and not self.replica.on_activate:
            self.every(self.replica.period_s, self._timer)
        elif awake and self.replica.on_activate:
            self.once(self.replica.period_s, partial(self._timer_of, self.activations))

    def _timer(self) -> None:
        output = self.replica.output if self.occupied is None or self.occupied() else None
        if self.state is State.ACTIVE and not self.hung and output is not None:
            self._sequence += 1
            self.sink(self.name, output, self._message())

    def _message(self) -> Message:
        return Message(self.name, self.life, self._sequence, self.world.now, self.replica.size)

    def _timer_of(self, activation: int) -> None:
        """Publish on a timer that was made at an activation, and end with it."""
        if activation == self.activations:
            self._timer()
            self.once(self.replica.period_s, partial(self._timer_of, activation))

    def change_state(self, transition: Transition, client: Process, answered: Act) -> None:
        """Serve the request; `answered(transition, success)` happens at the client, unless the reply is lost."""
        self.world.after(self._call_s(), self.deliver, self._change, transition, client, answered)

    def get_state(self, client: Process, answered: Act) -> None:
        """Serve the request; `answered(state)` happens at the client; a dead node never answers."""
        self.world.after(self._call_s(), self.deliver, self._read, client, answered)

    def _call_s(self) -> float:
        dice = self.world.dice
        return 0.0003 + dice.random() * (0.1 if dice.random() < RARE else 0.003)

    def _change(self, transition: Transition, client: Process, answered: Act) -> None:
        dice = self.world.dice
        start_s = max(self.world.now, self._busy_until_s)
        self._busy_until_s = start_s + 0.001 + dice.random() ** 3 * self.transition_s + self.slow_s
        self.world.at(self._busy_until_s, self._finish, self.life, transition, client, answered)

    def _finish(self, life: int, transition: Transition, client: Process, answered: Act) -> None:
        if life != self.life:
            return
        if self.stops:  # the callback ends when the process continues
            self.deliver(self._finish, life, transition, client, answered)
            return
        legal = self.state is FROM[transition] and not self.refusing
        if legal:
            self.state = GOAL[transition]
            self.activations += 1
            if self.state is State.ACTIVE:
                self._begin()
            self.world.note(self.name, "is", self.state.value)
        if not self.mute:
            client.post(self.name, answered, transition, legal)

    def _begin(self) -> None:
        """Become Active."""
        self.active_s = self.world.now
        if self.woken is not None:
            self.woken()
        if self.replica.on_activate:
            self.once(self.replica.period_s, partial(self._timer_of, self.activations))

    def _read(self, client: Process, answered: Act) -> None:
        if self._busy_until_s > self.world.now:
            self.world.at(self._busy_until_s, self.deliver, self._read, client, answered)
            return
        client.post(self.name, answered, self.state)
