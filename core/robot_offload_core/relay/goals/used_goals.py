"""Goals of the group at actions outside it: which may be offered, and when the old side's goals end (rule 11).

Decided on the robot for the goals of both sides, because the collector and the servers are there.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from robot_offload_core.fence.token import Site, Token
from robot_offload_core.relay.goals.state import View
from robot_offload_core.relay.goals.used import Admission, admit
from robot_offload_core.words.declared import UsedAction


class Move(Enum):
    """The decision on a goal."""

    OFFER = 1
    REFUSED = 2
    """Its side is the standby by now."""
    TIMEOUT = 3
    """Never offered, or never answered."""
    CANCEL = 4
    """The holder has changed since the goal was offered."""


@dataclass
class UsedGoal:
    """A goal of one side at a server outside.

    Attributes:
        token: of the cloud when its client sent the goal; None on the robot.
        relay: incarnation of the cloud's relay whose client sent it; "" on the robot.
        until_s: end of the wait for the offer; after the offer, of the wait for the server's answer.
        stay: the holder's stay when it was offered; None while it waits.
        accepted: the server has accepted it.
        cancel_due_s: when it is cancelled because of rule 11.
        cancelled: its cancel was ordered.
    """

    id: bytes
    spec: UsedAction
    site: Site
    token: Token | None
    payload: bytes
    until_s: float
    stay: int | None = None
    accepted: bool = False
    cancel_due_s: float = float("inf")
    cancelled: bool = False
    relay: str = ""


class UsedGoals:
    """All goals of both sides that have not ended outside.

    Attributes:
        actions: by public name.
        goals: by id, in order of arrival.
    """

    def __init__(self, actions: tuple[UsedAction, ...]) -> None:
        self.actions = {spec.name: spec for spec in actions}
        self.goals: dict[bytes, UsedGoal] = {}

    def settle(
        self, view: View, effects: Site | None, seen: frozenset[str], now_s: float
    ) -> list[tuple[UsedGoal, Move]]:
        """Return what is to be done now; a goal that is refused or has timed out is forgotten.

        Args:
            view: the holder, by the collector's memory.
            effects: the side whose effects control admits; None: neither's.
            seen: actions whose server outside is in the graph.
            now_s: steady clock.
        """
        moves: list[tuple[UsedGoal, Move]] = []
        for goal in list(self.goals.values()):
            move = self._wait(goal, view, effects, seen, now_s) if goal.stay is None else self._run(goal, view, now_s)
            if move in (Move.REFUSED, Move.TIMEOUT):
                del self.goals[goal.id]
            if move is not None:
                moves.append((goal, move))
        return moves

    def _wait(
        self, goal: UsedGoal, view: View, effects: Site | None, seen: frozenset[str], now_s: float
    ) -> Move | None:
        admission = admit(view, effects, goal.site, goal.token, goal.spec.of_cloud)
        if admission is Admission.REFUSE:
            return Move.REFUSED
        if now_s >= goal.until_s:
            return Move.TIMEOUT
        if admission is Admission.WAIT or goal.spec.name not in seen or not self._slot_free(goal):
            return None
        goal.stay, goal.until_s = view.holding.stay, now_s + goal.spec.timeout_s
        return Move.OFFER

    def _slot_free(self, goal: UsedGoal) -> bool:
        """Return whether no other offer of the action waits for its answer: offers arrive in the clients' order."""
        return not any(
            other.spec.name == goal.spec.name and other.stay is not None and not other.accepted
            for other in self.goals.values()
        )

    def _run(self, goal: UsedGoal, view: View, now_s: float) -> Move | None:
        if not goal.accepted and now_s >= goal.until_s:
            return Move.TIMEOUT
        if goal.stay != view.holding.stay and not goal.spec.of_cloud:
            goal.cancel_due_s = min(goal.cancel_due_s, now_s + goal.spec.cancel_after_s)
            if self._followed(goal, view):
                goal.cancel_due_s = now_s
        if now_s < goal.cancel_due_s or goal.cancelled:
            return None
        goal.cancelled = True
        return Move.CANCEL

    def _followed(self, goal: UsedGoal, view: View) -> bool:
        """Return whether the new side's first goal of that action was accepted."""
        return any(
            other.spec.name == goal.spec.name and other.accepted and other.stay == view.holding.stay
            for other in self.goals.values()
        )

    def orphaned(self, relay: str, now_s: float) -> list[UsedGoal]:
        """Drop or cancel the goals of the cloud's former relays, now that `relay` serves the cloud's group.

        Returns:
            The goals that waited, which are forgotten.
        """
        dropped = []
        for goal in [goal for goal in self.goals.values() if goal.site is Site.CLOUD and goal.relay != relay]:
            if goal.stay is None:
                dropped.append(self.goals.pop(goal.id))
            else:
                goal.cancel_due_s = now_s
        return dropped

    def due_s(self) -> float:
        """Return when a goal is given up or cancelled."""
        waits = [goal.until_s for goal in self.goals.values() if not goal.accepted]
        cancels = [goal.cancel_due_s for goal in self.goals.values() if not goal.cancelled]
        return min(waits + cancels, default=float("inf"))
