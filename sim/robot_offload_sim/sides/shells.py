"""The common part of both sides' shells in virtual time: datagrams between processes, beats as text, service calls."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import Any

from robot_offload_core.control.nodes import guardians, managed_nodes
from robot_offload_core.data.process import DataProcess
from robot_offload_core.data.states import CHANNEL, StateProcess
from robot_offload_core.pulse import pulse
from robot_offload_core.words import beats
from robot_offload_core.words.beats import Beat
from robot_offload_core.words.lifecycle import State
from robot_offload_core.words.messages import Carried, Heard
from robot_offload_sim.world.nodes import Node
from robot_offload_sim.world.ports import Surroundings
from robot_offload_sim.world.world import Host, Process

EFFECT_S = 0.037
TEXT_EVERY = 8
"""Every eighth beat crosses as text through the real codec, the others as objects: this keeps the simulation fast."""
TYPE = "simulated/msg/Payload"
LOOK_S = 0.5
"""As in the agent: how often nodes without a lifecycle are looked for."""
RENEWED_S = 0.030
"""An unchanged level waits in its receiver's inbox for at most about this long, until the receiver's next turn."""
SLACK_S = 0.010
"""As in the agent: how long a due message waits for a datagram to share the turn with."""
LATE_S = 1e-4
"""How much later than planned a timer may come."""


class Shell(Process):
    """A process of the agent around one of the core's classes.

    Attributes:
        peers: the other processes of this side by name; absent ones get nothing.
    """

    def __init__(self, around: Surroundings, host: Host, name: str, peers: dict[str, Shell]) -> None:
        super().__init__(around.world, host, f"{host.name}/{name}")
        self.around = around
        self.peers = peers
        self.renewed: list[tuple[str, object]] = []
        peers[name] = self

    @abstractmethod
    def take(self, message: object) -> None:
        """Take a datagram of another process."""

    def now_s(self) -> float:
        """Return the steady clock of this host."""
        host = self.host
        return host.offset_s + self.world.now * host.rate

    def system_s(self) -> float:
        """Return the system clock of this host."""
        return self.host.system_s()

    def send(self, to: str, message: object) -> bool:
        """Send a datagram to another process of this side."""
        peer = self.peers.get(to)
        if peer is None or not peer.alive:
            return False
        peer.read_renewed()
        peer.post(self.name, peer.take, message)
        return True

    def renew(self, to: str, message: object) -> bool:
        """Put an unchanged level into the inbox of another process, which reads it when it wakes."""
        peer = self.peers.get(to)
        if peer is None or not peer.alive:
            return False
        peer.renewed.append((self.name, message))
        self.world.after(self.world.dice.random() * RENEWED_S, peer.read_renewed)
        return True

    def read_renewed(self) -> None:
        """Take the levels that were only repeated, as this process has woken or is about to."""
        waiting, self.renewed = self.renewed, []
        for sender, message in waiting:
            self.post(sender, self.take, message)

    def carry(self, to: str, kind: bytes, index: int, header: bytes, payload: Any) -> bool:
        """Send an output's message to another process of this side."""
        return self.send(to, Carried(kind, index, header, payload))


class PulseShell(Shell):
    """A pulse process: beats are sent when due, or together with one that has just come.

    Attributes:
        state: state of the core's pulse.
        heard: the newest beat of the partner, in a memory file that outlives this process; the data process reads it
            for each message that it handles, however long the message has waited.
    """

    state: pulse.Pulse
    heard: Heard | None = None

    @abstractmethod
    def beat(self) -> None:
        """Send the next beat."""

    def turn(self) -> None:
        """Send the beat that was not sent together with one of the other side."""
        left_s = pulse.wake_s(self.state) - self.host.now_s()
        if left_s <= 0:
            self.beat()
            left_s = pulse.wake_s(self.state) - self.host.now_s()
        self.once(max(0.0, left_s) / self.host.rate + LATE_S * self.world.dice.random(), self.turn)

    def answer(self, arrived_s: float) -> None:
        """Send the next beat together with the one just received, if it is to go with that."""
        if pulse.joins(self.state, arrived_s):
            self.beat()


class DataShell(Shell):
    """A data process: turns when something is due, on top of the data session.

    Attributes:
        exchange: makes the exchange of state for a new process; None: no state is declared.
        damage: damages a state's bytes on the way.
    """

    process: DataProcess
    exchange: Callable[[DataProcess], StateProcess] | None = None
    damage: Callable[[bytes], bytes]
    states: StateProcess | None = None

    @property
    def lock(self) -> AbstractContextManager[Any]:
        """Return a lock without effect: there is one thread."""
        return nullcontext()

    def boot_timers(self) -> None:
        """Plan the first turn, and start the exchange of state over."""
        self.states = self.exchange(self.process) if self.exchange is not None else None
        self.once(self.world.dice.random() * 0.04, self._turn)

    def look_who_is_heard(self) -> None:
        """Take the newest beat of the partner."""
        pulse_shell = self.peers["pulse"]
        assert isinstance(pulse_shell, PulseShell)
        if pulse_shell.heard is not None:
            self.process.handle(pulse_shell.heard)

    def _turn(self) -> None:
        process = self.process
        process.woke()
        self.look_who_is_heard()
        process.turn()
        if self.states is not None:
            self.states.turn()
        slack_s = self.world.dice.random() * SLACK_S
        self.once(max(0.0, process.due_s - self.host.now_s()) + slack_s, self._turn)

    def take(self, message: object) -> None:
        """Take a datagram of another process."""
        self.process.woke()
        self.process.handle(message)
        self.look_who_is_heard()

    def arrived(self, channel: str, header: bytes, payload: Any) -> None:
        """Take a message from the link."""
        if self.states is not None and channel.startswith(CHANNEL):
            self.states.arrived(channel.removeprefix(CHANNEL), header, self.damage(payload))
        else:
            self.process.arrived(channel, header, payload)

    def link_status(self) -> tuple[bool, str]:
        """Return the state of the data session."""
        return self.around.link.data.connected, "quic"

    def reopen(self, _reason: str) -> None:
        """Open a new data session."""
        self.around.link.data.reopen()

    def types(self) -> dict[str, str]:
        """Return the one type that all payloads here have."""
        plan = self.process.plan
        return dict.fromkeys((*(o.name for o in plan.outputs), *(i.name for i in plan.inputs)), TYPE)

    def warn(self, message: str) -> None:
        """Keep a warning for the story."""
        self.world.note(self.name, message)


def written(beat: Beat) -> Beat | str:
    """Return the form in which a beat crosses the link."""
    return beats.encode(beat) if beat.sequence % TEXT_EVERY == 0 else beat


def read(sent: Beat | str) -> Beat | None:
    """Return the beat that arrived, None for garbage."""
    if isinstance(sent, Beat):
        return sent
    try:
        return beats.decode(sent)
    except beats.BeatError:
        return None


def call_node(
    control: Process, guard: Callable[[guardians.Event], None], nodes: dict[str, Node], command: managed_nodes.Command
) -> None:
    """Call a node's lifecycle service; an answer to an earlier life of control, or after the deadline, is lost."""
    life, world = control.life, control.world

    if isinstance(command, managed_nodes.ChangeState):
        until_s = world.now + command.deadline_s

        def changed(transition: managed_nodes.Transition, success: bool) -> None:
            if control.life == life and world.now <= until_s:
                guard(managed_nodes.Answered(command.name, transition, success))

        nodes[command.name].change_state(command.transition, control, changed)
    elif isinstance(command, managed_nodes.GetState):
        until_s = world.now + command.deadline_s

        def read_back(state: State) -> None:
            if control.life == life and world.now <= until_s:
                guard(managed_nodes.Observed(command.name, state))

        nodes[command.name].get_state(control, read_back)


def plain_nodes_seen(nodes: dict[str, Node]) -> guardians.Seen:
    """Return what the graph shows: nodes without a lifecycle whose process lives."""
    return guardians.Seen(tuple(name for name, node in nodes.items() if not node.spec.lifecycle and node.alive))
