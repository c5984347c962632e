"""The cloud relay's part for used names: calls and goals of the group here, on which the robot's relay decides."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

from robot_offload_core.fence.token import Token
from robot_offload_core.relay.goals.near import NearGoal, NearGoals
from robot_offload_core.relay.goals.ports import CloudRelayPorts, Face
from robot_offload_core.relay.goals.requests import SENTENCES, Failure
from robot_offload_core.relay.goals.state import CancelRequested
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
from robot_offload_core.words.declared import UsedAction, UsedService


@dataclass(frozen=True)
class UsedOut:
    """A call of a replica here."""

    service: str
    caller: bytes
    until_s: float


class CloudUsed:
    """The replicas' open calls and goals at used names, passed to the robot's relay.

    Attributes:
        calls: open ones.
        near: goals of the replicas here.
        tokens: token under which each goal was sent.
    """

    def __init__(
        self,
        plan: RelayPlan,
        ports: CloudRelayPorts,
        post: Post,
        acts_under: Callable[[UsedService | UsedAction], Token | None],
        counters: Counter[str],
    ) -> None:
        """`acts_under` returns the token under which the node of a used name may act now; None: it is the standby."""
        self.ports = ports
        self.post = post
        self.acts_under = acts_under
        self.counters = counters
        self.services = {spec.name: spec for spec in plan.used_services}
        self.actions = {spec.name: spec for spec in plan.used_actions}
        self.calls: dict[int, UsedOut] = {}
        self.near = NearGoals(plan.used_actions, ports, self._near_changed)
        self.tokens: dict[bytes, Token] = {}
        self.number = 0

    # -- services -----------------------------------------------------------------------------------------------------

    def called(self, name: str, caller: bytes, payload: bytes) -> None:
        """Pass a replica's call to the robot's relay; fail a standby's at once."""
        spec, self.number = self.services[name], self.number + 1
        token = self.acts_under(spec)
        self.calls[self.number] = UsedOut(name, caller, self.ports.now_s() + spec.timeout_s)
        if len(payload) > MAX_PAYLOAD:
            self._fail(self.number, Failure.TOO_LARGE)
        elif token is None or not self.post.courier.peer:
            self._fail(self.number, Failure.REFUSED)
        else:
            self.post.write(CallWord(Face.PUBLIC, name, self.number, self.post.named(token), False, payload))

    def answered(self, word: CalledWord) -> None:
        """Take the robot relay's answer."""
        call = self.calls.get(word.key)
        if call is None:
            return
        if word.verdict in (CallVerdict.DONE, CallVerdict.FAILED):
            del self.calls[word.key]
            self.ports.answer_call(Face.GROUP, call.service, call.caller, word.payload)
        else:
            self._fail(word.key, Failure.REFUSED if word.verdict is CallVerdict.NOT_HOLDER else Failure.TIMEOUT)

    def _fail(self, key: int, why: Failure) -> None:
        call = self.calls.pop(key)
        self.counters[f"{call.service}.{why.value}"] += 1
        self.ports.fail_call(Face.GROUP, call.service, call.caller, why.value, SENTENCES[why])

    # -- goals --------------------------------------------------------------------------------------------------------

    def goal_requested(self, name: str, caller: bytes, payload: bytes) -> None:
        """Accept a replica's goal and pass it to the robot's relay; refuse a standby's at once."""
        token, goal_id = self.acts_under(self.actions[name]), goal_id_of(payload)
        standby = token is None or not self.post.courier.peer
        if token is None or standby or goal_id is None or len(payload) > MAX_PAYLOAD:
            self.counters[f"{name}.{(Failure.REFUSED if standby else Failure.TOO_LARGE).value}"] += 1
            self.near.refuse(name, caller)
        elif self.near.accept(name, caller, goal_id):
            self.tokens[goal_id] = token
            self.post.write(OfferWord(Face.PUBLIC, name, goal_id, self.post.named(token), False, payload))

    def cancel_requested(self, asked: CancelRequested) -> None:
        """Take a replica's cancel."""
        for goal_id in self.near.cancel(asked):
            self.post.write(CancelWord(Face.PUBLIC, asked.action, goal_id))

    def take(self, word: OfferedWord | EndedWord | FeedbackWord) -> None:
        """Take what the robot's relay reports of a goal."""
        match word:
            case OfferedWord() if word.verdict is CallVerdict.DONE:
                self.near.executing(word.attempt)
            case OfferedWord():
                self.near.end(word.attempt)
            case EndedWord():
                self.near.end(word.attempt, word.status, word.payload)
            case FeedbackWord():
                self.near.feed(word.action, goal_id_of(word.payload) or b"", word.payload)

    def robot_relay_met(self) -> None:
        """Meet another relay of the robot: fail open calls, and ask it for the state of the goals."""
        for key in list(self.calls):
            self._fail(key, Failure.UNKNOWN)
        for goal in self.near.live():
            self.post.write(ResumeWord(Face.PUBLIC, goal.action, goal.id, self.post.named(self.tokens[goal.id]), False))
            if goal.cancel:
                self.post.write(CancelWord(Face.PUBLIC, goal.action, goal.id))

    def _near_changed(self, goal: NearGoal) -> None:
        if goal.ended_s is not None:
            self.tokens.pop(goal.id, None)

    # -- levels -------------------------------------------------------------------------------------------------------

    def turn(self) -> None:
        """Give up calls that waited too long."""
        now_s = self.ports.now_s()
        for key, call in list(self.calls.items()):
            if now_s >= call.until_s:
                self._fail(key, Failure.TIMEOUT)

    def due_s(self) -> float:
        """Return when `turn` has something to do."""
        return min((call.until_s for call in self.calls.values()), default=float("inf"))
