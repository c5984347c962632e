"""A guardian on duty: real nodes' behaviour as a table, time in steps of 10 ms, everything it commands written down."""

from __future__ import annotations

from robot_offload_core.control.nodes import guardians
from robot_offload_core.control.nodes.guardians import Guardian, InhibitAnswered
from robot_offload_core.control.nodes.managed_nodes import (
    GOAL,
    Answered,
    ChangeState,
    Command,
    GetState,
    Inhibit,
    NodeNews,
    Observed,
    Transition,
)
from robot_offload_core.words.events import Acting, Tick
from robot_offload_core.words.lifecycle import State
from robot_offload_core.words.settings import NodeSpec
from tests.unit.core.builders import NOW_S

STEP_S = 0.010
GRACE_S = 0.250
FROM = {
    Transition.CONFIGURE: State.UNCONFIGURED,
    Transition.ACTIVATE: State.INACTIVE,
    Transition.DEACTIVATE: State.ACTIVE,
}


class Shift:
    """Guards nodes that obey, unless they are told otherwise.

    Attributes:
        states: of the real nodes; UNKNOWN for one that is not running.
        mute: nodes that do what they are asked and never answer change_state.
        stubborn: nodes that refuse every transition.
        slow_s: from being asked to having done it, per node.
        driver: what the driver's service last did; None while it does not answer.
        driver_up: whether it answers.
    """

    def __init__(self, *specs: NodeSpec, driver: bool = False, state: State = State.UNCONFIGURED) -> None:
        self.now_s = NOW_S
        self.guardian: Guardian = guardians.start(specs, GRACE_S, has_driver=driver)
        self.states = {spec.name: state for spec in specs}
        self.mute: set[str] = set()
        self.stubborn: set[str] = set()
        self.slow_s: dict[str, float] = {}
        self.driver: bool | None = None
        self.driver_up = True
        self.log: list[tuple[float, Command]] = []
        self._due: list[tuple[float, ChangeState]] = []

    # -- what happens

    def happen(self, event: guardians.Event) -> None:
        """One event; what the guardian commands is carried out in the real world."""
        self.guardian, commands = guardians.step(self.guardian, event, self.now_s)
        for command in commands:
            self.log.append((self.now_s, command))
            if isinstance(command, ChangeState):
                self._due.append((self.now_s + self.slow_s.get(command.name, 0.0), command))
            elif isinstance(command, GetState):
                if self.states[command.name] is not State.UNKNOWN:
                    self.happen(Observed(command.name, self.states[command.name]))
            elif isinstance(command, Inhibit) and self.driver_up:
                self.driver = command.inhibit
                self.happen(InhibitAnswered(command.inhibit))

    def run(self, duration_s: float) -> None:
        """Time passes."""
        for _ in range(round(duration_s / STEP_S)):
            self.now_s += STEP_S
            due, self._due = self._due, []
            for when_s, command in due:
                if when_s > self.now_s:
                    self._due.append((when_s, command))
                else:
                    self._carry_out(command)
            self.happen(Tick())

    def act(self, acting: bool = True, *, flow: bool = True, in_charge: bool = True) -> None:
        """The machine of this side says whether to act."""
        self.happen(Acting(acting, flow, in_charge))

    def restart(self, name: str) -> None:
        """A node's process is new."""
        self.states[name] = State.UNCONFIGURED
        self.happen(Observed(name, State.UNCONFIGURED))

    def _carry_out(self, command: ChangeState) -> None:
        name, transition = command.name, command.transition
        if self.states[name] is State.UNKNOWN:
            return
        able = self.states[name] is FROM[transition] and name not in self.stubborn
        if able:
            self.states[name] = GOAL[transition]
        if name not in self.mute:
            self.happen(Answered(name, transition, able))

    # -- what was seen

    def asked(self) -> list[tuple[str, str]]:
        """Transitions asked for, in order, as (node, transition)."""
        return [(c.name, c.transition.value) for _, c in self.log if isinstance(c, ChangeState)]

    def asked_s(self, name: str) -> list[float]:
        """When transitions of a node were asked for, from the beginning."""
        return [t - NOW_S for t, c in self.log if isinstance(c, ChangeState) and c.name == name]

    def inhibits(self) -> list[tuple[float, bool]]:
        """What the driver was asked, and when, from the beginning."""
        return [(round(t - NOW_S, 3), c.inhibit) for t, c in self.log if isinstance(c, Inhibit)]

    def reasons(self, name: str) -> list[str]:
        """Reasons told about a node."""
        return [c.reason for _, c in self.log if isinstance(c, NodeNews) and c.name == name]

    def forget(self) -> None:
        """Only what follows is of interest."""
        self.log.clear()
