"""Working copy of one step: changed goals, and the commands that result."""

from __future__ import annotations

from collections.abc import Iterator

from robot_offload_core.fence.token import Site, Token
from robot_offload_core.relay.goals.ports import GoalStatus
from robot_offload_core.relay.goals.questions import acts
from robot_offload_core.relay.goals.state import (
    MAX_KEPT,
    MAX_KEPT_BYTES,
    AnswerGoal,
    AnswerResult,
    Attempt,
    Command,
    Goal,
    GoalClosed,
    Ledger,
    PublishStatus,
    View,
    Why,
)
from robot_offload_core.relay.goals.wire_ids import attempt_id
from robot_offload_core.words.declared import ActionSpec
from robot_offload_core.words.replace import replace


class Work:
    """One step on a copy of the ledger.

    Attributes:
        ledger: before the step.
        view: see View.
        now_s: steady clock.
        goals: as they are now.
        commands: in order.
        shown: actions whose status is to be published.
    """

    def __init__(self, ledger: Ledger, view: View, now_s: float) -> None:
        self.ledger = ledger
        self.view = view
        self.now_s = now_s
        self.holding = ledger.holding
        self.changed_s = ledger.changed_s
        self.goals = ledger.goals
        self.index = ledger.index
        self.counter = ledger.counter
        self.commands: list[Command] = []
        self.shown: set[str] = set()

    def live(self) -> Iterator[Goal]:
        """Return the goals that have not ended, in the client's order."""
        return iter([goal for goal in self.goals.values() if goal.ended_s is None])

    def all(self) -> Iterator[Goal]:
        """Return all goals, in the client's order."""
        return iter(list(self.goals.values()))

    def acts(self, goal: Goal) -> tuple[Site, Token | None]:
        """Return the side that executes the goal, and its token."""
        return acts(self.view, self.spec(goal))

    def spec(self, goal: Goal) -> ActionSpec:
        """Return the declaration of the goal's action."""
        return self.ledger.actions[goal.action]

    def count(self) -> int:
        """Return the next number of this ledger."""
        self.counter += 1
        return self.counter

    def seen(self) -> Ledger:
        """Return the ledger at this point of the step, for questions."""
        return replace(self.ledger, goals=self.goals)

    def put(self, goal: Goal) -> None:
        """Store a goal that is new or has changed."""
        if self.goals is self.ledger.goals:
            self.goals = dict(self.goals)
        self.goals[goal.id] = goal

    def find(self, attempt: bytes) -> tuple[Goal | None, Attempt | None]:
        """Return the goal of an attempt, and the attempt."""
        goal = self.goals.get(self.index.get(attempt, b""))
        if goal is None:
            return None, None
        return goal, next((a for a in goal.attempts if a.id == attempt), None)

    def attempt(self, goal: Goal, attempt: Attempt) -> Goal:
        """Store an attempt that is new or has changed; return its goal."""
        others = [a for a in goal.attempts if a.id != attempt.id]
        known = len(others) < len(goal.attempts)
        attempts = tuple(attempt if a.id == attempt.id else a for a in goal.attempts) if known else (*others, attempt)
        if not known:
            self.index = {**self.index, attempt.id: goal.id}
        goal = replace(goal, attempts=attempts)
        self.put(goal)
        return goal

    def new_attempt(self, goal: Goal, site: Site, token: Token) -> Attempt:
        """Make an attempt under an id of its own."""
        attempt = Attempt(attempt_id(self.ledger.incarnation, self.count()), site, token, self.now_s)
        self.attempt(goal, attempt)
        return attempt

    def offers_until_s(self, goal: Goal) -> float:
        """Return until when the goal is offered to the holder.

        `timeout` counts from when the holder is able, at most `prepareDeadline` after the need began.
        """
        latest_s = goal.need_s + self.ledger.prepare_deadline_s
        able_s = latest_s if goal.able_s is None else min(goal.able_s, latest_s)
        return able_s + self.spec(goal).timeout_s

    def end(self, goal: Goal, status: GoalStatus, result: bytes = b"", why: Why | None = None) -> None:
        """End a goal for its client, with its one result."""
        if goal.caller:  # for its client the goal was refused; nobody ever hears of it again
            self.commands.append(AnswerGoal(goal.action, goal.caller, False, 0, why))
        for caller in goal.waiting:
            self.commands.append(AnswerResult(goal.action, caller, status, result))
        self.commands.append(GoalClosed(goal.action, goal.id, status, why))
        self.shown.add(goal.action)
        goal = replace(goal, status=status, result=result, why=why, ended_s=self.now_s, waiting=())
        self.put(goal)

    def done(self) -> Ledger:
        """Return the ledger after the step, without goals that are no longer needed."""
        self._forget()
        for action in sorted(self.shown):
            entries = tuple(g.entry for g in self.goals.values() if g.action == action and not g.caller)
            self.commands.append(PublishStatus(action, entries))
        if self.goals is not self.ledger.goals:
            self.index = {a.id: g.id for g in self.goals.values() for a in g.attempts}
        return replace(
            self.ledger, holding=self.holding, changed_s=self.changed_s, goals=self.goals, index=self.index,
            counter=self.counter,
        )  # fmt: skip

    def _forget(self) -> None:
        """Forget ended goals whose result was kept long enough, and the oldest when there are too many (rule 8)."""
        kept = [goal for goal in self.goals.values() if goal.ended_s is not None]
        kept.sort(key=lambda goal: goal.ended_s or 0.0)
        size = sum(len(goal.result) for goal in kept)
        count = len(kept)
        for goal in kept:
            old = self.now_s - (goal.ended_s or 0.0) > self.spec(goal).result_timeout_s
            if not old and count <= MAX_KEPT and size <= MAX_KEPT_BYTES:
                continue
            if self.goals is self.ledger.goals:
                self.goals = dict(self.goals)
            del self.goals[goal.id]
            self.shown.add(goal.action)
            count -= 1
            size -= len(goal.result)
