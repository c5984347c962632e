"""The cloud's relay: its servers execute the robot's requests under exactly the token that the cloud may act under."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from math import isfinite

from robot_offload_core.fence import lease
from robot_offload_core.fence.token import Site, Token
from robot_offload_core.relay.cloud_used import CloudUsed
from robot_offload_core.relay.goals.executor import (
    CANCEL_AGAIN_S,
    SEEN_WITHIN_S,
    Executor,
    OfferAnswered,
    Outcome,
    Run,
    RunEnded,
    RunGone,
)
from robot_offload_core.relay.goals.ports import ALL_GOALS, CancelCode, CloudRelayPorts, Face, GoalStatus
from robot_offload_core.relay.goals.state import CancelRequested
from robot_offload_core.relay.goals.wire_ids import goal_id_of
from robot_offload_core.relay.goals.words import (
    CalledWord,
    CallVerdict,
    CallWord,
    CancelWord,
    EndedWord,
    FeedbackWord,
    Hello,
    OfferedWord,
    OfferWord,
    ResumeWord,
    Word,
)
from robot_offload_core.relay.pools import Pools
from robot_offload_core.relay.post import Post
from robot_offload_core.relay.process import MAX_PAYLOAD, STATUS_S, RelayPlan, RelayProcess, status_problems
from robot_offload_core.words.declared import ActionSpec, ServiceSpec, UsedAction, UsedService
from robot_offload_core.words.events import SetEgress
from robot_offload_core.words.lifecycle import State
from robot_offload_core.words.messages import Egress, Letters, RelayStatus

ORPHAN_S = 1.0
"""Attempts of an ended token go on this long, so that the robot can name those that continue."""


@dataclass(frozen=True)
class Pending:
    """A call at a server here: `key` of the robot's relay `peer`. `of_cloud`: its node has placement Cloud."""

    peer: str
    key: int
    of_cloud: bool = False


class CloudRelay(RelayProcess):
    """The cloud's relay: takes the robot relay's words and calls the servers here.

    Attributes:
        egress: what control lets leave, and until when.
        ends: end of the lease of each token that something was admitted under.
        newest: epoch of the newest word for the standby.
        inherited: actions whose server may still execute what a predecessor of this relay began. From inherited_s on,
            the robot's relay or a cancel of all goals settles that.
        sweeping: until when such a cancel may take effect.
        calls: at servers here.
        used: calls and goals of the replicas here at used names.
        pools: distributes the calls at nodes with several pods.
        dirty: something other than feedback arrived since the last turn.
        turn_due_s: when there is something to do otherwise.
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
        self.number = 0
        self.counters: Counter[str] = Counter()
        self.status: RelayStatus | None = None
        self.status_due_s = self.turn_due_s = ports.now_s()
        self.dirty = True
        self._of = {s.name: s.node for s in plan.services} | {a.name: a.node for a in plan.actions}
        self._actions = {spec.name for spec in plan.actions}
        served: tuple[ServiceSpec | ActionSpec, ...] = (*plan.services, *plan.actions)
        self.inherited, self.inherited_s = set(self._actions), ports.now_s() + ORPHAN_S
        self.sweeping: dict[str, float] = {}
        self._of_cloud = {spec.name for spec in served if spec.of_cloud}
        self.used = CloudUsed(plan, ports, self.post, self.acts_under, self.counters)
        self.pools = Pools(plan.services, ports, self.counters)

    # -- who may ------------------------------------------------------------------------------------------------------

    def admits(self, token: Token) -> bool:
        """Return whether something may begin under a token: exactly the one that this side may act under now."""
        egress = self.egress.egress if self.egress is not None else None
        return egress is not None and lease.leaves(egress, self.ports.now_s()) == token

    def admits_present(self, token: Token) -> bool:
        """Return whether a node with placement Cloud may begin something under a token: exactly that of presence."""
        egress = self.egress.egress if self.egress is not None else None
        return egress is not None and lease.leaves(egress, self.ports.now_s(), of_cloud=True) == token

    def _admits_word(self, name: str, token: Token, *, standby: bool) -> bool:
        if name in self._of_cloud:
            return self.admits_present(token)
        if not standby:
            return self.admits(token)
        admitted = self.admits_standby(token)
        self.newest = max(self.newest, token.epoch) if admitted else self.newest
        return admitted

    def admits_standby(self, token: Token) -> bool:
        """Return whether a word for the standby counts: of the robot that is served, and of no older epoch."""
        return self.egress is not None and token.robot == self.egress.robot and token.epoch >= self.newest

    def take_egress(self, egress: Egress) -> None:
        """Take what control lets leave; a token that is replaced has ended."""
        now_s = self.ports.now_s()
        before = self.egress.egress.token if self.egress is not None else None
        after = egress.egress.token
        if before is not None and before != after:
            self.ends[before] = min(self.ends.get(before, now_s), now_s)
            self.ended_s = now_s
        if egress.egress.presence is not None:
            self.ends[egress.egress.presence] = egress.egress.presence_end_s
        if after is not None:
            self.ends[after] = egress.egress.lease_end_s
            self.newest = max(self.newest, after.epoch) if self.egress is not None else after.epoch
        if self.egress is not None and self.egress.robot != egress.robot:
            self.newest = after.epoch if after is not None else 0
        self.egress = egress
        self.post.agent, self.post.veils = egress.robot, egress.veils

    # -- the shell ----------------------------------------------------------------------------------------------------

    @property
    def due_s(self) -> float:
        """Return when `turn` has something to do."""
        return float("-inf") if self.dirty else self.turn_due_s

    def turn(self) -> None:
        """Do what is due. Feedback alone makes nothing due."""
        now_s = self.ports.now_s()
        if now_s < self.due_s:
            return
        self.dirty = False
        self._cancel_orphans(now_s)
        self._cancel_inherited(now_s)
        self.own.turn()
        self.used.turn()
        self.pools.turn()
        self.post.turn(self._hello())
        self._report(now_s)
        runs = [self._runs_until_s(run) for run in self.own.runs.values() if not run.cancel]
        inherited = [self._inherited_until_s(action) for action in self.inherited & self.own.seen.keys()]
        parts = (part.due_s() for part in (self.post, self.own, self.used, self.pools))
        self.turn_due_s = min([self.status_due_s, *parts, *runs, *inherited])

    def handle(self, message: object) -> None:
        """Take control's level and the robot relay's words."""
        self.dirty = True
        if isinstance(message, Egress):
            self.take_egress(message)
        elif isinstance(message, Letters):
            word, met = self.post.take(message.data)
            if met:
                self.calls.clear()
                self.pools.forget()
                self._unname()
                self.used.robot_relay_met()
            if word is not None:
                self._take(word)

    def servers_seen(self, servers: Iterable[tuple[Face, str, str]]) -> None:
        """Take the servers in the graph."""
        self.dirty = True
        seen = {name: endpoints for face, name, endpoints in servers if face is Face.GROUP}
        self.services = {n: endpoints for n, endpoints in seen.items() if n not in self.pools.services}
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
                self._resume(word)
            case CallWord():
                self._call(word)
            case CalledWord():
                self.used.answered(word)
            case OfferedWord() | EndedWord() | FeedbackWord():
                self.used.take(word)
            case _:
                pass

    def _offer(self, word: OfferWord) -> None:
        admitted = self._admits_word(word.action, word.token, standby=word.mirror)
        swept = self.ports.now_s() < self.sweeping.get(word.action, 0.0)
        if not admitted or swept or word.action not in self.own.seen:
            self.counters["offers.not_holder"] += 1
            self.own.done[word.attempt] = None
            self.post.write(OfferedWord(Face.GROUP, word.attempt, CallVerdict.NOT_HOLDER))
            return
        self.own.offer(word.action, word.attempt, word.payload, word.token, mirror=word.mirror)

    def _resume(self, word: ResumeWord) -> None:
        """Continue an attempt. The grant of its token may arrive shortly after the word."""
        if word.action not in self._actions:
            self.counters["resumes.undeclared"] += 1
            self._outcome(RunGone(word.attempt))
            return
        self.own.resume(word.action, word.attempt, word.token, mirror=word.mirror)
        run = self.own.runs.get(word.attempt)
        if run is not None:
            run.named_until_s = max(run.named_until_s, self.ports.now_s() + ORPHAN_S)

    def _call(self, word: CallWord) -> None:
        admitted = self._admits_word(word.service, word.token, standby=word.standby)
        if not admitted or not self._begin_call(word):
            self.counters["calls.not_holder"] += 1
            self.post.write(CalledWord(Face.GROUP, word.key, CallVerdict.NOT_HOLDER, b""))
            return
        self.calls[self.number] = Pending(self.post.courier.peer, word.key, word.service in self._of_cloud)

    def _begin_call(self, word: CallWord) -> bool:
        """Call a server here under the next number; return False if there is none."""
        if word.service in self.pools.services:
            self.number += 1
            return self.pools.call(word.service, self.number, word.payload)
        if word.service not in self.services or word.service not in self._of:
            return False
        self.number += 1
        self.ports.call(Face.GROUP, word.service, self.number, word.payload)
        return True

    def _outcome(self, outcome: Outcome) -> None:
        """Report a server's answer or result, even without a lease: a report is not an effect."""
        match outcome:
            case OfferAnswered():
                verdict = CallVerdict.DONE if outcome.accepted else CallVerdict.REFUSED
                self.post.write(OfferedWord(Face.GROUP, outcome.attempt, verdict))
            case RunEnded():
                self.post.write(EndedWord(Face.GROUP, outcome.attempt, outcome.status, outcome.leased, outcome.result))
            case RunGone():
                self.post.write(EndedWord(Face.GROUP, outcome.attempt, GoalStatus.UNKNOWN, False, b""))

    # -- servers here -------------------------------------------------------------------------------------------------

    def offer_answered(self, face: Face, name: str, goal_id: bytes, accepted: bool) -> None:
        """Take the answer to an offer."""
        self.dirty = True
        self.own.offer_answered(goal_id, accepted)

    def cancel_answered(self, face: Face, name: str, goal_id: bytes, code: CancelCode) -> None:
        """Take the answer to a cancel."""
        self.dirty = True
        if goal_id == ALL_GOALS:
            self.sweeping.pop(name, None)
        else:
            self.own.cancel_answered(goal_id, code)

    def result_arrived(self, face: Face, name: str, goal_id: bytes, status: GoalStatus, payload: bytes) -> None:
        """Take a result, and whether this side was still allowed to act."""
        self.dirty = True
        run = self.own.runs.get(goal_id)
        leased = run is not None and (self.admits(run.token) or self.admits_present(run.token))
        if len(payload) > MAX_PAYLOAD:
            self.counters[f"{name}.too_large"] += 1
            payload = b""
        self.own.result_arrived(goal_id, status, payload, leased)

    def feedback_arrived(self, face: Face, name: str, payload: bytes) -> None:
        """Pass feedback on; the robot decides whether a client gets it."""
        attempt = goal_id_of(payload)
        sequence = self.own.feedback_arrived(attempt) if attempt is not None else 0
        if sequence and len(payload) <= MAX_PAYLOAD:
            self.post.write_once(FeedbackWord(Face.GROUP, name, sequence, payload))

    def call_answered(self, key: int, payload: bytes, success: bool = True) -> None:
        """Take an answer and pass it on to the relay that asked."""
        self.dirty = True
        self.pools.answered(key)
        pending = self.calls.pop(key, None)
        if pending is None or pending.peer != self.post.courier.peer:
            return
        if len(payload) > MAX_PAYLOAD:
            self.counters["answers.too_large"] += 1
            payload, success = b"", False
        verdict = CallVerdict.DONE if success else CallVerdict.FAILED
        self.post.write(CalledWord(Face.GROUP, pending.key, verdict, payload))

    # -- replicas here, as clients of used names ----------------------------------------------------------------------

    def acts_under(self, spec: UsedService | UsedAction) -> Token | None:
        """Return the token under which the node of a used name may act now; None while it is the standby."""
        egress = self.egress.egress if self.egress is not None else None
        return None if egress is None else lease.leaves(egress, self.ports.now_s(), of_cloud=spec.of_cloud)

    def called(self, face: Face, name: str, caller: bytes, payload: bytes) -> None:
        """Take a replica's call at a used name."""
        self.dirty = True
        self.used.called(name, caller, payload)

    def goal_requested(self, face: Face, name: str, caller: bytes, payload: bytes) -> None:
        """Take a replica's goal at a used action."""
        self.dirty = True
        self.used.goal_requested(name, caller, payload)

    def cancel_requested(self, face: Face, name: str, caller: bytes, goal_id: bytes, stamp_ns: int) -> None:
        """Take a replica's cancel."""
        self.dirty = True
        self.used.cancel_requested(CancelRequested(name, caller, goal_id, stamp_ns))

    def result_requested(self, face: Face, name: str, caller: bytes, goal_id: bytes) -> None:
        """Take a replica's request for a result."""
        self.dirty = True
        self.used.near.ask_result(name, caller, goal_id)

    # -- levels -------------------------------------------------------------------------------------------------------

    def _cancel_orphans(self, now_s: float) -> None:
        """Cancel attempts of a token that ended a second ago (rule 4)."""
        for attempt, run in list(self.own.runs.items()):
            if now_s >= self._runs_until_s(run):
                self.own.cancel(attempt)
        tokens = {run.token for run in self.own.runs.values()}
        egress = self.egress.egress if self.egress is not None else None
        current = {egress.token, egress.presence} if egress is not None else set()
        self.ends = {token: end for token, end in self.ends.items() if token in tokens or token in current}

    def _inherited_until_s(self, action: str) -> float:
        egress = self.egress.egress if self.egress is not None else SetEgress(None, 0.0)
        end_s = egress.presence_end_s if action in self._of_cloud else egress.lease_end_s
        runs = [self._runs_until_s(run) for run in self.own.runs.values() if run.action == action and not run.cancel]
        named_s = self._named_s()
        return max(self.inherited_s, end_s + ORPHAN_S, *runs, named_s if isfinite(named_s) else 0.0)

    def _named_s(self) -> float:
        """Return when the robot's relay has named its attempts and cancelled those that it gave up.

        Its letters are repeated meanwhile, so it must be heard; infinity while it is not.
        """
        return self.post.known_s + ORPHAN_S if self.post.heard() else float("inf")

    def _cancel_inherited(self, now_s: float) -> None:
        """End what a predecessor began and the robot does not name: all goals of an action, as their ids are unknown.

        Wait until nothing of that action may run on. Offer nothing new to the server until it has answered, because the
        cancel would end that too.
        """
        if now_s >= self._named_s():
            self.inherited.clear()
        for action in sorted(self.inherited & self.own.seen.keys()):
            if now_s < self._inherited_until_s(action):
                continue
            self.inherited.discard(action)
            self.sweeping[action] = now_s + CANCEL_AGAIN_S
            self.ports.cancel(Face.GROUP, action, ALL_GOALS)

    def _unname(self) -> None:
        """Let mirrors run on until a new relay of the robot has had time to name them again."""
        until_s = self.ports.now_s() + SEEN_WITHIN_S
        for run in self.own.runs.values():
            run.named_until_s = min(run.named_until_s, until_s)

    def _runs_until_s(self, run: Run) -> float:
        return max(self.ends.get(run.token, 0.0) + ORPHAN_S, run.named_until_s)

    def _up(self) -> tuple[str, ...]:
        nodes = dict(self.egress.nodes) if self.egress is not None else {}
        active = State.ACTIVE.value
        names = {*self.services, *self.pools.up()}
        return tuple(sorted(n for n in names if nodes.get(self._of.get(n, ""), active) == active))

    def _hello(self) -> Hello:
        agent = self.egress.incarnation if self.egress is not None else ""
        heard = self.post.hello
        site, stay = (heard.site, heard.stay) if heard is not None else (Site.ROBOT, 0)
        return Hello(agent, site, stay, self._up(), self._executing())

    def _executing(self) -> tuple[str, ...]:
        return tuple(sorted({run.action for run in self.own.runs.values() if run.accepted}))

    def _busy(self, now_s: float) -> bool:
        """Return whether nodes still have goals or calls of an ended token, within `cancelDeadline`."""
        token = self.egress.egress.token if self.egress is not None else None
        runs = [r for r in self.own.runs.values() if r.action not in self._of_cloud and r.named_until_s <= now_s]
        ended_s = max((self.ends.get(run.token, 0.0) for run in runs), default=self.ended_s)
        held = token is not None and self.admits(token)
        waits = bool(runs) or any(not call.of_cloud for call in self.calls.values())
        return not held and waits and now_s < ended_s + self.plan.cancel_deadline_s

    def _report(self, now_s: float) -> None:
        token = self.egress.egress.token if self.egress is not None else None
        holder = Site.CLOUD if token is not None and self.admits(token) else Site.ROBOT
        status = RelayStatus(None, (), "", self._busy(now_s), self._executing(), holder=holder)
        if status == self.status and now_s < self.status_due_s:
            return
        self.status, self.status_due_s = status, now_s + STATUS_S
        self.ports.send("control", status_problems(status, self.post, self.counters))
