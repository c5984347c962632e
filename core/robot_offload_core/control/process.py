"""What the control processes of both sides share: the guardian, and which level is sent again when.

All calls come from the one thread that decides.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Protocol, TypeVar

from robot_offload_core.control.holding import RELAY_UNHEARD_S, holding
from robot_offload_core.control.nodes import guardians, managed_nodes
from robot_offload_core.control.nodes.guardians import Flowing, Guardian
from robot_offload_core.control.nodes.managed_nodes import NodeEvent
from robot_offload_core.words import checks
from robot_offload_core.words.beats import Beat
from robot_offload_core.words.checks import InvariantError
from robot_offload_core.words.events import Machine, Tick, Witness
from robot_offload_core.words.messages import PulseSent
from robot_offload_core.words.problems import Problem
from robot_offload_core.words.settings import OutputSpec

Before = TypeVar("Before")
Taken = TypeVar("Taken")
Done = TypeVar("Done")


class ControlPorts(Protocol):
    """What the shell does for a control process."""

    def now_s(self) -> float:
        """Return the steady clock, seconds."""

    def send(self, to: str, message: object) -> bool:
        """Send a message to another process of this agent."""

    def renew(self, to: str, message: object) -> bool:
        """Send a level that has not changed: it is read when its receiver wakes for another reason."""

    def carry_out(self, command: managed_nodes.Command) -> None:
        """Call a lifecycle service or the driver, or log what the guardian reports."""

    def answer(self, key: int, accepted: bool, message: str) -> None:
        """Answer a switch by hand."""

    def network_status(self, sustained: int) -> None:
        """Publish whether the link sustains the cloud: 1 if it does, 0 if it no longer does."""


class ControlProcess(ABC):
    """Base class of the control processes of both sides.

    Attributes:
        guardian: state of the guardian's machine.
        told_ready: readiness of this side's nodes as last taken into account.
        told_asleep: outputs whose nodes were asleep then.
        occasions: outputs, by index, whose `while.topic` arrives here.
        executing: actions that this side executes, as the relay reported at relay_s.
        witness: sees every step of the machines; None for no witness.
    """

    def __init__(
        self, ports: ControlPorts, incarnation: str, guard: Guardian,
        outputs: tuple[OutputSpec, ...] = (), publishers: tuple[str, ...] = (),
    ) -> None:  # fmt: skip
        self.ports = ports
        self.incarnation = incarnation
        self.guardian = guard
        self._checked: Guardian | None = None
        self._idle: Guardian | None = None
        self._idle_until_s = 0.0
        self.told_ready: bool | None = None
        self.told_asleep: tuple[int, ...] = ()
        self.told_sustained = 0
        self._outputs = outputs
        self._published = tuple(zip(outputs, publishers))  # noqa: B905 - publishers may be unknown
        self.occasions: tuple[int, ...] = ()
        self.executing: tuple[str, ...] = ()
        self.relay_s: float | None = None
        self.witness: Witness | None = None

    def watched_by(self, witness: Witness) -> None:
        """Let `witness` see every step from now on."""
        self.witness = witness
        witness.restated(Machine.GUARDIAN, self.ports.now_s(), self.guardian)

    def watched(
        self, machine: Machine, step: Callable[[Before, Taken, float], tuple[Before, Done]],
        before: Before, event: Taken, now_s: float,
    ) -> tuple[Before, Done]:  # fmt: skip
        """Run a step of a machine, show it to the witness even if it breaks a rule, and return its result.

        Raises:
            InvariantError, AssertionError: the step breaks a rule.
        """
        try:
            after, commands = step(before, event, now_s)
        except (InvariantError, AssertionError) as error:
            if self.witness is not None:
                self.witness.broke(machine, now_s, event, checks.rule_of(error))
            raise
        if self.witness is not None:
            self.witness.stepped(machine, now_s, event, after, commands)
        return after, commands

    def guard(self, event: guardians.Event) -> None:
        """Step the guardian and carry out its commands."""
        now_s = self.ports.now_s()
        self.guardian, commands = self.watched(Machine.GUARDIAN, guardians.step, self.guardian, event, now_s)
        for command in commands:
            self.ports.carry_out(command)
        self.check_ready()

    def check_ready(self) -> None:
        """Call `ready_changed` if the readiness of this side's nodes has changed, and once at the start."""
        if self.guardian is self._checked:
            return
        self._checked = self.guardian
        ready, asleep = self.is_ready(), self.asleep()
        if (ready, asleep) != (self.told_ready, self.told_asleep):
            self.told_ready, self.told_asleep = ready, asleep
            self.ready_changed(ready)

    def is_ready(self) -> bool:
        """Return whether this side's CORE nodes are Active."""
        return guardians.is_ready(self.guardian)

    def asleep(self) -> tuple[int, ...]:
        """Return the rated outputs, by index, whose node is known and not Active; only the robot needs them."""
        return ()

    def note_flowing(self, outputs: tuple[int, ...]) -> None:
        """Pass the nodes of flowing rated outputs to the guardian: they are alive, however slowly they answer."""
        rated = [(i, name) for i, (o, name) in enumerate(self._published) if o.deadline_s > 0 and name]
        silent = {name for i, name in rated if i not in outputs}
        names = tuple(dict.fromkeys(name for _, name in rated if name not in silent))
        if names != self.guardian.flowing:
            self.guard(Flowing(names))

    def holding(self) -> tuple[int, ...]:
        """Return the outputs, by index, whose `while` is true on this side; without actions if the relay is silent."""
        executing = () if self.unjudged() else self.executing
        return holding(self._outputs, executing, self.occasions)

    def unjudged(self) -> tuple[str, str] | None:
        """Return a problem if the relay is silent, since outputs rated during an action are then not judged."""
        names = [o.shown for o in self._outputs if o.while_ is not None and o.while_.actions]
        silent = self.relay_s is None or self.ports.now_s() - self.relay_s > RELAY_UNHEARD_S
        if not names or not silent:
            return None
        message = f"The relay does not say which goals run: {', '.join(names)} may be silent unnoticed"
        return Problem.RELAY_SILENT, message

    def degraded(self) -> tuple[str, str] | None:
        """Return a problem if nodes that are not CORE are dead, refuse or were given up."""
        names = guardians.degraded(self.guardian)
        if not names:
            return None
        return NodeEvent.DEGRADED, f"Should be Active and are not: {', '.join(names)}; nobody waits for them"

    def node_states(self) -> tuple[tuple[str, str], ...]:
        """Return (node, state) of each node of this side; a node without a lifecycle is active while it is seen."""
        return tuple((n.spec.name, n.state.value) for n in self.guardian.nodes)

    def turn(self) -> None:
        """Tick the machine and the guardian, and publish the network status if it changed."""
        self.tick()
        self._guard_tick()
        if self.sustained() != self.told_sustained:
            self.told_sustained = 1 - self.told_sustained
            self.ports.network_status(self.told_sustained)

    def _guard_tick(self) -> None:
        """Tick the guardian, unless its last Tick did nothing and nothing is due."""
        now_s = self.ports.now_s()
        if self.guardian is self._idle and now_s < self._idle_until_s:
            return
        before = self.guardian
        self.guard(Tick())
        self._idle = self.guardian if self.guardian is before else None
        self._idle_until_s = guardians.due_s(self.guardian, now_s)

    def next_deadline_s(self) -> float:
        """Return when a turn is needed before the next period; infinite if there is nothing to wait for."""
        return float("inf")

    # -- what each side does in its own way ---------------------------------------------------------------------------

    @abstractmethod
    def arrived(self, beat: Beat, arrived_s: float, wall_us: int, sent: PulseSent | None = None) -> None:
        """Take a beat of the other side, and our own newest beat if it came with it."""

    @abstractmethod
    def handle(self, message: object) -> None:
        """Take any other datagram."""

    @abstractmethod
    def tick(self) -> None:
        """Tick the machine."""

    @abstractmethod
    def ready_changed(self, ready: bool) -> None:
        """Take the changed readiness of this side's nodes."""

    @abstractmethod
    def sustained(self) -> int:
        """Return 1 if the link sustains the cloud, else 0."""
