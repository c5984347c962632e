"""Goals of a side's own nodes at actions outside the group, as these clients see them. Both relays have such a table.

A client is accepted at once (behaviour trees wait 20 ms). The robot decides what becomes of its goal outside, see
`used_goals`. Each client gets one result for each goal, made here if the server gave none.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from robot_offload_core.relay.goals.ports import CancelCode, Face, GoalEntry, GoalStatus, RelayPorts
from robot_offload_core.relay.goals.questions import meant
from robot_offload_core.relay.goals.state import MAX_KEPT, MAX_KEPT_BYTES, MAX_LIVE, CancelRequested
from robot_offload_core.relay.goals.wire_ids import NO_GOAL
from robot_offload_core.words.declared import UsedAction

KEPT_S = 900.0
"""A result is kept this long for a client that has not asked, as in rclpy's servers."""
STATUS = slice(4, 5)
"""Place of the status in the serialized response of `get_result`."""


@dataclass
class NearGoal:
    """A goal of a client here.

    Attributes:
        id: the client's, and the server's: a goal is offered to one server once.
        stamp_ns: when it was accepted.
        cancel: the client requested a cancel.
        waiting: open requests for its result.
        result: the server's response; b"": a default one.
        ended_s: when it ended; None while it lives.
    """

    id: bytes
    action: str
    stamp_ns: int
    status: GoalStatus = GoalStatus.ACCEPTED
    cancel: bool = False
    waiting: list[bytes] = field(default_factory=list)
    result: bytes = b""
    ended_s: float | None = None

    @property
    def entry(self) -> GoalEntry:
        """Return how status messages show the goal."""
        return GoalEntry(self.id, self.stamp_ns, self.status)


class NearGoals:
    """The table of goals. `changed` is called with each goal that is new, has changed, or is forgotten.

    Attributes:
        goals: by id, in the clients' order.
    """

    def __init__(self, actions: tuple[UsedAction, ...], ports: RelayPorts, changed: Callable[[NearGoal], None]) -> None:
        self.actions = {spec.name: spec for spec in actions}
        self.ports = ports
        self.changed = changed
        self.goals: dict[bytes, NearGoal] = {}

    # -- clients ------------------------------------------------------------------------------------------------------

    def accept(self, action: str, caller: bytes, goal_id: bytes) -> bool:
        """Accept a client's goal at once; return False if it is refused: its id is known, or too many live."""
        live = sum(1 for goal in self.goals.values() if goal.ended_s is None)
        if goal_id in self.goals or live >= MAX_LIVE:
            self.refuse(action, caller)
            return False
        goal = self.goals[goal_id] = NearGoal(goal_id, action, self.ports.wall_ns())
        self.changed(goal)
        self.ports.answer_goal(Face.GROUP, action, caller, True, goal.stamp_ns)
        self._show(action)
        return True

    def refuse(self, action: str, caller: bytes) -> None:
        """Refuse a client's goal."""
        self.ports.answer_goal(Face.GROUP, action, caller, False, 0)

    def cancel(self, asked: CancelRequested) -> list[bytes]:
        """Answer a cancel at once; return the goals that are to end."""
        chosen = [
            goal for goal in self.goals.values()
            if goal.action == asked.action and goal.ended_s is None and meant(asked, goal.id, goal.stamp_ns)
        ]  # fmt: skip
        code = CancelCode.NONE
        if asked.goal_id != NO_GOAL and not chosen:
            code = CancelCode.TERMINATED if asked.goal_id in self.goals else CancelCode.UNKNOWN_GOAL
        for goal in chosen:
            goal.cancel, goal.status = True, GoalStatus.CANCELING
            self.changed(goal)
        entries = tuple(goal.entry for goal in chosen)
        self.ports.answer_cancel(Face.GROUP, asked.action, asked.caller, code, entries)
        self._show(asked.action)
        return [goal.id for goal in chosen]

    def ask_result(self, action: str, caller: bytes, goal_id: bytes) -> None:
        """Answer a request for a result, now or when the goal ends."""
        goal = self.goals.get(goal_id)
        if goal is None or goal.action != action:
            self.ports.answer_result(Face.GROUP, action, caller, GoalStatus.UNKNOWN, b"")
        elif goal.ended_s is not None:
            self.ports.answer_result(Face.GROUP, action, caller, goal.status, goal.result)
        elif caller not in goal.waiting:
            goal.waiting.append(caller)
            self.changed(goal)

    # -- what became of goals -----------------------------------------------------------------------------------------

    def executing(self, goal_id: bytes) -> None:
        """Record that the server has accepted a goal."""
        goal = self.goals.get(goal_id)
        if goal is not None and goal.status is GoalStatus.ACCEPTED:
            goal.status = GoalStatus.EXECUTING
            self.changed(goal)
            self._show(goal.action)

    def end(self, goal_id: bytes, status: GoalStatus = GoalStatus.ABORTED, result: bytes = b"") -> bool:
        """End a goal for its client; return whether it was still open. UNKNOWN: its server has forgotten it."""
        goal = self.goals.get(goal_id)
        if goal is None or goal.ended_s is not None:
            return False
        goal.status, goal.result = _for_client(goal, status, result)
        goal.ended_s = self.ports.now_s()
        waiting, goal.waiting = goal.waiting, []
        self.changed(goal)
        for caller in waiting:
            self.ports.answer_result(Face.GROUP, goal.action, caller, goal.status, goal.result)
        self._show(goal.action)
        self._forget()
        return True

    def feed(self, action: str, goal_id: bytes, payload: bytes) -> None:
        """Pass on feedback of a live goal."""
        goal = self.goals.get(goal_id)
        if goal is not None and goal.ended_s is None:
            self.ports.publish_feedback(Face.GROUP, action, payload)

    def live(self) -> list[NearGoal]:
        """Return the goals that have not ended."""
        return [goal for goal in self.goals.values() if goal.ended_s is None]

    def _forget(self) -> None:
        """Forget results that were kept long enough, and the oldest ones when there are too many."""
        now_s = self.ports.now_s()
        kept = sorted((g for g in self.goals.values() if g.ended_s is not None), key=lambda g: g.ended_s or 0.0)
        size, count = sum(len(goal.result) for goal in kept), len(kept)
        for goal in kept:
            if now_s - (goal.ended_s or 0.0) <= KEPT_S and count <= MAX_KEPT and size <= MAX_KEPT_BYTES:
                return
            del self.goals[goal.id]
            self.changed(goal)
            size, count = size - len(goal.result), count - 1

    def _show(self, action: str) -> None:
        entries = tuple(goal.entry for goal in self.goals.values() if goal.action == action)
        self.ports.publish_status(Face.GROUP, action, entries)


def _for_client(goal: NearGoal, status: GoalStatus, result: bytes) -> tuple[GoalStatus, bytes]:
    """Return the end as the client gets it: never CANCELED unless the client asked for that (invariant 6e)."""
    if status is GoalStatus.UNKNOWN:
        return (GoalStatus.CANCELED if goal.cancel else GoalStatus.ABORTED), b""
    if status is GoalStatus.CANCELED and not goal.cancel:
        aborted = bytes([GoalStatus.ABORTED])
        return GoalStatus.ABORTED, result and result[: STATUS.start] + aborted + result[STATUS.stop :]
    return status, result
