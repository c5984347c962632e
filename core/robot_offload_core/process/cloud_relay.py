"""The cloud's relay: lets its own servers execute what the robot asks under exactly the token it may act under."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

from robot_offload_core.guardians import State
from robot_offload_core.ledger.executor import Executor, OfferAnswered, Outcome, RunEnded, RunGone
from robot_offload_core.ledger.ports import CancelCode, CloudRelayPorts, Face, GoalStatus
from robot_offload_core.ledger.requests import SENTENCES, Failure
from robot_offload_core.ledger.wire_ids import goal_id_of
from robot_offload_core.ledger.words import (
    CalledWord,
    CallWord,
    CancelWord,
    EndedWord,
    FeedbackWord,
    Hello,
    OfferedWord,
    OfferWord,
    ResumeWord,
    Verdict,
    Word,
)
from robot_offload_core.process.messages import Egress, Letters, RelayStatus
from robot_offload_core.process.relay import MAX_PAYLOAD, STATUS_S, RelayPlan, RelayProcess, status_problems
from robot_offload_core.process.relay_post import Post
from robot_offload_core.token import Site, Token

ORPHAN_S = 1.0
"""Attempts of an ended token run so long: the robot may still name them."""


@dataclass(frozen=True)
class Pending:
    """A call at a server here: `key` of the robot's relay `peer`, or `caller` of a replica here."""

    peer: str
    key: int


@dataclass(frozen=True)
class UsedOut:
    """A replica's call at a used name, which the robot's relay decides."""

    service: str
    caller: bytes
    until_s: float


class CloudRelay(RelayProcess):
    """See the module.

    Attributes:
        egress: what control says may leave, and until when.
        ends: end of the lease of each token that something was admitted under.
        newest: epoch of the newest word for the standby.
        calls: at servers here. used: calls of the replicas here at used names.
    """

    def __init__(self, plan: RelayPlan, ports: CloudRelayPorts, incarnation: str) -> None:
        self.plan = plan
        self.ports = ports
        self.post = Post(incarnation, ports)
        self.own = Executor(Face.GROUP, ports, self._outcome)
        self.egress: Egress | None = None
        self.ends: dict[Token, float] = {}
        self.ended_s = float("-inf")
        self.newest = 0
        self.services: dict[str, str] = {}
        self.calls: dict[int, Pending] = {}
        self.used: dict[int, UsedOut] = {}
        self.number = 0
        self.counters: Counter[str] = Counter()
        self.status: RelayStatus | None = None
        self.status_due_s = ports.now_s()
        self._of = {s.name: s.node for s in plan.services} | {a.name: a.node for a in plan.actions}
        self._used = {spec.name: spec for spec in plan.used_services}

    # -- who may ------------------------------------------------------------------------------------------------------

    def admits(self, token: Token) -> bool:
        """Returns whether something may begin under a token: exactly the one that this side may act under, now."""
        egress = self.egress.egress if self.egress is not None else None
        return egress is not None and egress.token == token and self.ports.now_s() < egress.lease_end_s

    def admits_standby(self, token: Token) -> bool:
        """Returns whether a word for the standby counts: of the robot that is served, and of no older epoch."""
        return self.egress is not None and token.robot == self.egress.robot and token.epoch >= self.newest

    def take_egress(self, egress: Egress) -> None:
        """Takes what control says; a token that is replaced has ended."""
        now_s = self.ports.now_s()
        before = self.egress.egress.token if self.egress is not None else None
        after = egress.egress.token
        if before is not None and before != after:
            self.ends[before] = min(self.ends.get(before, now_s), now_s)
            self.ended_s = now_s
        if after is not None:
            self.ends[after] = egress.egress.lease_end_s
            self.newest = max(self.newest, after.epoch) if self.egress is not None else after.epoch
        if self.egress is not None and self.egress.robot != egress.robot:
            self.newest = after.epoch if after is not None else 0
        self.egress = egress
        self.post.agent = egress.robot

    # -- the shell ----------------------------------------------------------------------------------------------------

    @property
    def due_s(self) -> float:
        """Returns when `turn` has something to do."""
        runs = [self.ends.get(run.token, 0.0) + ORPHAN_S for run in self.own.runs.values() if not run.cancel]
        waits = [call.until_s for call in self.used.values()]
        return min([self.post.due_s(), self.status_due_s, self.own.due_s(), *runs, *waits])

    def turn(self) -> None:
        """Does what is due."""
        now_s = self.ports.now_s()
        self._cancel_orphans(now_s)
        self.own.turn()
        for key, call in list(self.used.items()):
            if now_s >= call.until_s:
                self._fail_used(key, Failure.TIMEOUT)
        self.post.turn(self._hello())
        self._report(now_s)

    def handle(self, message: object) -> None:
        """Takes control's level and the robot relay's words."""
        if isinstance(message, Egress):
            self.take_egress(message)
        elif isinstance(message, Letters):
            word, met = self.post.take(message.data)
            if met:
                self.calls.clear()
                for key in list(self.used):
                    self._fail_used(key, Failure.UNKNOWN)
            if word is not None:
                self._take(word)

    def servers_seen(self, servers: Iterable[tuple[Face, str, str]]) -> None:
        """Takes the servers in the graph."""
        seen = {name: endpoints for face, name, endpoints in servers if face is Face.GROUP}
        self.services = seen
        actions = {spec.name for spec in self.plan.actions}
        self.own.servers_seen({name: endpoints for name, endpoints in seen.items() if name in actions})

    # -- the robot's words --------------------------------------------------------------------------------------------

    def _take(self, word: Word) -> None:
        match word:
            case OfferWord():
                self._offer(word)
            case CancelWord():
                self.own.cancel(word.attempt)
            case ResumeWord():
                self.own.resume(word.action, word.attempt, word.token)
            case CallWord():
                self._call(word)
            case CalledWord():
                self._used_answered(word)
            case _:
                pass

    def _offer(self, word: OfferWord) -> None:
        if not self.admits(word.token) or word.action not in self.own.seen:
            self.counters["offers.not_holder"] += 1
            self.own.done[word.attempt] = None
            self.post.write(OfferedWord(Face.GROUP, word.attempt, Verdict.NOT_HOLDER))
            return
        self.own.offer(word.action, word.attempt, word.payload, word.token)

    def _call(self, word: CallWord) -> None:
        if word.standby:
            admitted = self.admits_standby(word.token)
            self.newest = max(self.newest, word.token.epoch) if admitted else self.newest
        else:
            admitted = self.admits(word.token)
        if not admitted or word.service not in self.services or word.service not in self._of:
            self.counters["calls.not_holder"] += 1
            self.post.write(CalledWord(Face.GROUP, word.key, Verdict.NOT_HOLDER, b""))
            return
        self.number += 1
        self.calls[self.number] = Pending(self.post.courier.peer, word.key)
        self.ports.call(Face.GROUP, word.service, self.number, word.payload)

    def _outcome(self, outcome: Outcome) -> None:
        """Reports what a server did; without a lease too: no answer and no result is an effect."""
        match outcome:
            case OfferAnswered():
                verdict = Verdict.DONE if outcome.accepted else Verdict.REFUSED
                self.post.write(OfferedWord(Face.GROUP, outcome.attempt, verdict))
            case RunEnded():
                self.post.write(EndedWord(Face.GROUP, outcome.attempt, outcome.status, outcome.leased, outcome.result))
            case RunGone():
                self.post.write(EndedWord(Face.GROUP, outcome.attempt, GoalStatus.UNKNOWN, False, b""))

    # -- servers here -------------------------------------------------------------------------------------------------

    def offer_answered(self, face: Face, name: str, goal_id: bytes, accepted: bool) -> None:
        """Takes the answer to an offer."""
        self.own.offer_answered(goal_id, accepted)

    def cancel_answered(self, face: Face, name: str, goal_id: bytes, code: CancelCode) -> None:
        """Takes the answer to a cancel."""
        self.own.cancel_answered(goal_id, code)

    def result_arrived(self, face: Face, name: str, goal_id: bytes, status: GoalStatus, payload: bytes) -> None:
        """Takes a result, and whether this side was still allowed to act."""
        run = self.own.runs.get(goal_id)
        leased = run is not None and self.admits(run.token)
        if len(payload) > MAX_PAYLOAD:
            self.counters[f"{name}.too_large"] += 1
            payload = b""
        self.own.result_arrived(goal_id, status, payload, leased)

    def feedback_arrived(self, face: Face, name: str, payload: bytes) -> None:
        """Passes feedback on; the robot decides whether a client hears it."""
        attempt = goal_id_of(payload)
        sequence = self.own.feedback_arrived(attempt) if attempt is not None else 0
        if sequence and len(payload) <= MAX_PAYLOAD:
            self.post.write_once(FeedbackWord(Face.GROUP, name, sequence, payload))

    def call_answered(self, key: int, payload: bytes, success: bool = True) -> None:
        """Takes an answer and passes it on to the relay that asked."""
        pending = self.calls.pop(key, None)
        if pending is None or pending.peer != self.post.courier.peer:
            return
        if len(payload) > MAX_PAYLOAD:
            self.counters["answers.too_large"] += 1
            payload, success = b"", False
        verdict = Verdict.DONE if success else Verdict.FAILED
        self.post.write(CalledWord(Face.GROUP, pending.key, verdict, payload))

    # -- replicas here, as clients of used names ----------------------------------------------------------------------

    def called(self, face: Face, name: str, caller: bytes, payload: bytes) -> None:
        """Passes a replica's call at a used name to the robot's relay; a standby's fails at once."""
        spec = self._used[name]
        egress = self.egress.egress if self.egress is not None else None
        token = egress.token if egress is not None else None
        self.number += 1
        self.used[self.number] = UsedOut(name, caller, self.ports.now_s() + spec.timeout_s)
        if len(payload) > MAX_PAYLOAD:
            self._fail_used(self.number, Failure.TOO_LARGE)
        elif token is None or not self.admits(token) or not self.post.courier.peer:
            self._fail_used(self.number, Failure.REFUSED)
        else:
            self.post.write(CallWord(Face.PUBLIC, name, self.number, token, False, payload))

    def _used_answered(self, word: CalledWord) -> None:
        call = self.used.get(word.key)
        if call is None:
            return
        if word.verdict in (Verdict.DONE, Verdict.FAILED):
            del self.used[word.key]
            self.ports.answer_call(Face.GROUP, call.service, call.caller, word.payload)
        else:
            self._fail_used(word.key, Failure.REFUSED if word.verdict is Verdict.NOT_HOLDER else Failure.TIMEOUT)

    def _fail_used(self, key: int, why: Failure) -> None:
        call = self.used.pop(key)
        self.counters[f"{call.service}.{why.value}"] += 1
        self.ports.fail_call(Face.GROUP, call.service, call.caller, why.value, SENTENCES[why])

    def goal_requested(self, face: Face, name: str, caller: bytes, payload: bytes) -> None:
        """Refuses: used actions are not relayed yet, and validation refuses them."""
        self.ports.answer_goal(face, name, caller, False, 0)

    def cancel_requested(self, face: Face, name: str, caller: bytes, goal_id: bytes, stamp_ns: int) -> None:
        """Knows no goal, see `goal_requested`."""
        self.ports.answer_cancel(face, name, caller, CancelCode.UNKNOWN_GOAL, ())

    def result_requested(self, face: Face, name: str, caller: bytes, goal_id: bytes) -> None:
        """Knows no goal, see `goal_requested`."""
        self.ports.answer_result(face, name, caller, GoalStatus.UNKNOWN, b"")

    # -- levels -------------------------------------------------------------------------------------------------------

    def _cancel_orphans(self, now_s: float) -> None:
        """Cancels attempts of a token that ended a second ago (rule 4)."""
        for attempt, run in list(self.own.runs.items()):
            if now_s >= self.ends.get(run.token, 0.0) + ORPHAN_S:
                self.own.cancel(attempt)
        tokens = {run.token for run in self.own.runs.values()}
        current = self.egress.egress.token if self.egress is not None else None
        self.ends = {token: end for token, end in self.ends.items() if token in tokens or token == current}

    def _up(self) -> tuple[str, ...]:
        nodes = dict(self.egress.nodes) if self.egress is not None else {}
        active = State.ACTIVE.value
        return tuple(sorted(n for n in self.services if nodes.get(self._of.get(n, ""), active) == active))

    def _hello(self) -> Hello:
        agent = self.egress.incarnation if self.egress is not None else ""
        heard = self.post.hello
        site, stay = (heard.site, heard.stay) if heard is not None else (Site.ROBOT, 0)
        return Hello(agent, site, stay, self._up(), self._executing())

    def _executing(self) -> tuple[str, ...]:
        return tuple(sorted({run.action for run in self.own.runs.values() if run.accepted}))

    def _busy(self, now_s: float) -> bool:
        """Returns whether the nodes still have goals or calls of an ended token, for `cancelDeadline`."""
        token = self.egress.egress.token if self.egress is not None else None
        ended_s = max((self.ends.get(run.token, 0.0) for run in self.own.runs.values()), default=self.ended_s)
        held = token is not None and self.admits(token)
        return not held and bool(self.own.runs or self.calls) and now_s < ended_s + self.plan.cancel_deadline_s

    def _report(self, now_s: float) -> None:
        token = self.egress.egress.token if self.egress is not None else None
        holder = Site.CLOUD if token is not None and self.admits(token) else Site.ROBOT
        status = RelayStatus(None, (), "", self._busy(now_s), self._executing(), holder=holder)
        if status == self.status and now_s < self.status_due_s:
            return
        self.status, self.status_due_s = status, now_s + STATUS_S
        self.ports.send("control", status_problems(status, self.post, self.counters))
