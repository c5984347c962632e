"""The robot relay's part for used names: calls and goals of the group at servers outside, of both sides."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable

from robot_offload_core.fence.token import Site, Token
from robot_offload_core.relay.goals import journal
from robot_offload_core.relay.goals.executor import Executor, OfferAnswered, Outcome, RunEnded, RunGone
from robot_offload_core.relay.goals.near import NearGoal, NearGoals
from robot_offload_core.relay.goals.ports import Face, GoalStatus, RobotRelayPorts
from robot_offload_core.relay.goals.requests import SENTENCES, Failure
from robot_offload_core.relay.goals.state import CancelRequested, View
from robot_offload_core.relay.goals.used import Admission, UsedCall, UsedCalls, Verdicts, admit
from robot_offload_core.relay.goals.used_goals import Move, UsedGoal, UsedGoals
from robot_offload_core.relay.goals.wire_ids import goal_id_of
from robot_offload_core.relay.goals.words import (
    CalledWord,
    CallVerdict,
    CallWord,
    CancelWord,
    EndedWord,
    FeedbackWord,
    OfferedWord,
    OfferWord,
    ResumeWord,
)
from robot_offload_core.relay.post import Post
from robot_offload_core.relay.process import MAX_PAYLOAD, RelayPlan
from robot_offload_core.words.messages import RelayOrders

NOBODY = Token("", 0, "")
"""Token of the robot's own goals at servers: nothing depends on it here."""
NO_STAY = -1


class RobotUsed:
    """Both sides' calls and goals at servers outside.

    Attributes:
        calls: of both sides at services outside.
        goals: of both sides at actions outside.
        near: goals of the robot's own nodes, as their clients see them.
        out: the goals at the servers.
        orders: of control.
    """

    def __init__(
        self,
        plan: RelayPlan,
        ports: RobotRelayPorts,
        post: Post,
        view: Callable[[], View],
        keep: Callable[[bytes], bool],
        counters: Counter[str],
    ) -> None:
        self.ports = ports
        self.post = post
        self.view = view
        self.keep = keep
        self.counters = counters
        self.calls = UsedCalls(plan.used_services)
        self.goals = UsedGoals(plan.used_actions)
        self.near = NearGoals(plan.used_actions, ports, self._near_changed)
        self.out = Executor(Face.PUBLIC, ports, self._outcome)
        self.orders: RelayOrders | None = None
        self.number = 0

    def succeed(self, said: journal.Replayed) -> None:
        """Continue the goals of a predecessor; fail its open calls."""
        for caller, service in said.calls.items():
            if service in self.calls.services:
                self._fail(
                    UsedCall(self.calls.services[service], Site.ROBOT, None, b"", 0.0, caller), Failure.RELAY_RESTARTED
                )
        self.near.goals = {goal.id: goal for goal in said.near.values() if goal.action in self.near.actions}
        for kept in said.used.values():
            self._go_on(kept)
        for near in self.near.live():
            if near.id not in self.goals.goals:
                self.near.end(near.id)

    def _go_on(self, kept: journal.UsedKept) -> None:
        """Take over a goal of a predecessor: if it was offered it runs, unless its server reports otherwise."""
        spec = self.goals.actions.get(kept.action)
        if spec is None:
            return
        until_s = self.ports.now_s() + spec.timeout_s
        goal = UsedGoal(kept.id, spec, kept.site, kept.token, kept.payload, until_s, kept.stay, relay=kept.relay)
        self.goals.goals[goal.id] = goal
        if goal.stay is not None:
            goal.accepted = True
            self.out.resume(spec.name, goal.id, NOBODY)

    def records(self) -> list[bytes]:
        """Return what a successor needs, as records of the journal."""
        used = [_record(g) for g in self.goals.goals.values()]
        near = [journal.near_kept(goal) for goal in self.near.goals.values()]
        calls = [journal.call_opened(c.caller, c.spec.name) for c in self.calls.calls if c.caller]
        return used + near + calls

    def settle(self) -> None:
        """Decide calls and goals under the present view."""
        now_s, view = self.ports.now_s(), self.view()
        effects = self.orders.effects if self.orders is not None else None
        for call, verdict in self.calls.settle(view, effects, now_s):
            self._decide(call, verdict)
        seen = frozenset(self.out.seen)
        for goal, move in self.goals.settle(view, effects, seen, now_s):
            self._move(goal, move)

    # -- services -----------------------------------------------------------------------------------------------------

    def called(self, name: str, caller: bytes, payload: bytes) -> None:
        """Take a call of the robot's group."""
        spec = self.calls.services[name]
        until_s = self.ports.now_s() + spec.timeout_s
        call = UsedCall(spec, Site.ROBOT, None, payload, until_s, caller)
        if len(payload) > MAX_PAYLOAD:
            self._fail(call, Failure.TOO_LARGE)
            return
        self.keep(journal.call_opened(caller, name))
        self.calls.calls.append(call)
        self.settle()

    def called_in_cloud(self, word: CallWord) -> None:
        """Take a call of the cloud's group."""
        spec = self.calls.services.get(word.service)
        if spec is None:
            self.post.write(CalledWord(Face.PUBLIC, word.key, CallVerdict.REFUSED, b""))
            return
        until_s = self.ports.now_s() + spec.timeout_s
        self.calls.calls.append(UsedCall(spec, Site.CLOUD, word.token, word.payload, until_s, key=word.key))
        self.settle()

    def _decide(self, call: UsedCall, verdict: Verdicts) -> None:
        if verdict is Verdicts.CALL:
            self.number -= 1
            call.number = self.number
            self.ports.call(Face.PUBLIC, call.spec.name, call.number, call.payload)
        elif call.site is Site.CLOUD:
            refused = CallVerdict.NOT_HOLDER if verdict is Verdicts.REFUSED else CallVerdict.REFUSED
            self.post.write(CalledWord(Face.PUBLIC, call.key, refused, b""))
        else:
            self._fail(call, Failure.REFUSED if verdict is Verdicts.REFUSED else Failure.TIMEOUT)

    def _fail(self, call: UsedCall, why: Failure) -> None:
        self.counters[f"{call.spec.name}.{why.value}"] += 1
        self.keep(journal.call_closed(call.caller))
        self.ports.fail_call(Face.GROUP, call.spec.name, call.caller, why.value, SENTENCES[why])

    def answered(self, number: int, payload: bytes, success: bool) -> None:
        """Take the answer of a service outside; the keys of its calls are negative."""
        call = self.calls.answered(number)
        if call is None:
            return
        if call.site is Site.ROBOT:
            self.keep(journal.call_closed(call.caller))
            self.ports.answer_call(Face.GROUP, call.spec.name, call.caller, payload)
        else:
            verdict = CallVerdict.DONE if success else CallVerdict.FAILED
            self.post.write(CalledWord(Face.PUBLIC, call.key, verdict, payload))

    # -- goals: clients of the robot's group --------------------------------------------------------------------------

    def goal_requested(self, name: str, caller: bytes, payload: bytes) -> None:
        """Take a goal of the robot's group; accept it at once if its side may act or is preparing."""
        spec, goal_id = self.goals.actions[name], goal_id_of(payload)
        effects = self.orders.effects if self.orders is not None else None
        standby = admit(self.view(), effects, Site.ROBOT, None) is Admission.REFUSE
        if standby or goal_id is None or len(payload) > MAX_PAYLOAD:
            self.counters[f"{name}.{(Failure.REFUSED if standby else Failure.TOO_LARGE).value}"] += 1
            self.near.refuse(name, caller)
        elif self.near.accept(name, caller, goal_id):
            self._add(UsedGoal(goal_id, spec, Site.ROBOT, None, payload, self.ports.now_s() + spec.timeout_s))

    def cancel_requested(self, asked: CancelRequested) -> None:
        """Take a cancel of the robot's group."""
        for goal_id in self.near.cancel(asked):
            self._cancel(goal_id)

    # -- goals: the cloud relay's words -------------------------------------------------------------------------------

    def take(self, word: OfferWord | CancelWord | ResumeWord) -> None:
        """Take what the cloud's relay writes about a goal of its group."""
        spec = self.goals.actions.get(word.action)
        if spec is None:
            self._tell_ended(word.attempt, GoalStatus.UNKNOWN, b"")
        elif isinstance(word, CancelWord):
            self._cancel(word.attempt)
        elif isinstance(word, ResumeWord):
            self._resume(word, spec.name)
        elif word.attempt not in self.goals.goals:
            until_s = self.ports.now_s() + spec.timeout_s
            peer = self.post.courier.peer
            self._add(UsedGoal(word.attempt, spec, Site.CLOUD, word.token, word.payload, until_s, relay=peer))

    def _resume(self, word: ResumeWord, name: str) -> None:
        """Report the state of a goal that the cloud's relay gave to a predecessor."""
        goal = self.goals.goals.get(word.attempt)
        if goal is None:
            stay = self.view().holding.stay if word.token == self.view().holding.token else NO_STAY
            spec, peer = self.goals.actions[name], self.post.courier.peer
            goal = UsedGoal(word.attempt, spec, Site.CLOUD, word.token, b"", 0.0, stay, True, relay=peer)
            self.goals.goals[goal.id] = goal
            self.out.resume(name, word.attempt, NOBODY)
        elif goal.accepted:
            self.post.write(OfferedWord(Face.PUBLIC, goal.id, CallVerdict.DONE))

    def cloud_relay_met(self) -> None:
        """Meet another relay of the cloud's group: drop or cancel the goals of the former one's clients."""
        for goal in self.goals.orphaned(self.post.courier.peer, self.ports.now_s()):
            self.keep(journal.used_ended(goal.id))
        self.settle()

    # -- goals: both --------------------------------------------------------------------------------------------------

    def _add(self, goal: UsedGoal) -> None:
        self.goals.goals[goal.id] = goal
        if not self._kept(goal):
            del self.goals.goals[goal.id]
            self.counters[f"{goal.spec.name}.JournalFull"] += 1
            self._end(goal, GoalStatus.ABORTED, b"")
            return
        self.settle()

    def _kept(self, goal: UsedGoal) -> bool:
        return self.keep(_record(goal))

    def _move(self, goal: UsedGoal, move: Move) -> None:
        if move is Move.OFFER:
            self._kept(goal)
            self.out.offer(goal.spec.name, goal.id, goal.payload, NOBODY)
        elif move is Move.CANCEL:
            self.counters[f"{goal.spec.name}.HolderChanged"] += 1
            self.out.cancel(goal.id)
        else:
            why = Failure.REFUSED if move is Move.REFUSED else Failure.TIMEOUT
            self.counters[f"{goal.spec.name}.{why.value}"] += 1
            if goal.stay is not None:
                self.out.cancel(goal.id)  # as soon as it is known to the server, until it is gone
            self._end(goal, GoalStatus.ABORTED, b"")

    def _cancel(self, goal_id: bytes) -> None:
        goal = self.goals.goals.get(goal_id)
        if goal is None:
            return
        if goal.stay is None:
            del self.goals.goals[goal_id]
            self._end(goal, GoalStatus.CANCELED, b"")
        else:
            goal.cancelled = True
            self.out.cancel(goal_id)

    def _outcome(self, outcome: Outcome) -> None:
        goal = self.goals.goals.get(outcome.attempt)
        if goal is None:
            return
        if isinstance(outcome, OfferAnswered) and outcome.accepted:
            goal.accepted = True
            if goal.site is Site.ROBOT:
                self.near.executing(goal.id)
            else:
                self.post.write(OfferedWord(Face.PUBLIC, goal.id, CallVerdict.DONE))
            self.settle()
            return
        del self.goals.goals[goal.id]
        match outcome:
            case OfferAnswered():
                self.counters[f"{goal.spec.name}.GoalRefused"] += 1
                self._end(goal, GoalStatus.ABORTED, b"")
            case RunEnded():
                self._end(goal, outcome.status, outcome.result)
            case RunGone():
                self.counters[f"{goal.spec.name}.GoalForgotten"] += 1
                self._end(goal, GoalStatus.UNKNOWN, b"")

    def _end(self, goal: UsedGoal, status: GoalStatus, result: bytes) -> None:
        self.keep(journal.used_ended(goal.id))
        if goal.site is Site.ROBOT:
            self.near.end(goal.id, status, result)
        else:
            self._tell_ended(goal.id, status, result)

    def _tell_ended(self, goal_id: bytes, status: GoalStatus, result: bytes) -> None:
        self.post.write(EndedWord(Face.PUBLIC, goal_id, status, True, result))

    def _near_changed(self, goal: NearGoal) -> None:
        known = goal.id in self.near.goals
        self.keep(journal.near_kept(goal) if known else journal.near_forgotten(goal.id))

    # -- servers outside ----------------------------------------------------------------------------------------------

    def feedback_arrived(self, name: str, payload: bytes) -> None:
        """Take feedback of a server outside."""
        goal_id = goal_id_of(payload)
        goal = self.goals.goals.get(goal_id) if goal_id is not None else None
        if goal is None or goal.spec.name != name or len(payload) > MAX_PAYLOAD:
            return
        if goal.site is Site.ROBOT:
            self.near.feed(name, goal.id, payload)
        else:
            self.post.write_once(FeedbackWord(Face.PUBLIC, name, self.out.feedback_arrived(goal.id), payload))

    def servers_seen(self, servers: Iterable[tuple[Face, str, str]]) -> None:
        """Take the servers in the graph."""
        actions = self.goals.actions
        self.out.servers_seen({name: text for face, name, text in servers if face is Face.PUBLIC and name in actions})
        self.settle()

    # -- levels -------------------------------------------------------------------------------------------------------

    def due_s(self) -> float:
        """Return when there is something to do."""
        return min(self.calls.due_s(), self.goals.due_s(), self.out.due_s())

    def idle(self) -> bool:
        """Return whether no call and no goal is open."""
        return not (self.calls.calls or self.goals.goals)


def _record(goal: UsedGoal) -> bytes:
    kept = journal.UsedKept(goal.id, goal.spec.name, goal.site, goal.token, goal.stay, goal.relay, goal.payload)
    return journal.used_kept(kept)
