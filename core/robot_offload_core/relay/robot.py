"""The robot's relay: the only server that clients know. Its ledger and its desk decide which side executes."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable

from robot_offload_core.fence.token import Site, Token, presence
from robot_offload_core.relay.goals import attempts, journal, machine, questions, state
from robot_offload_core.relay.goals.executor import Executor, OfferAnswered, Outcome, RunEnded, RunGone
from robot_offload_core.relay.goals.ports import CancelCode, Face, GoalStatus, RobotRelayPorts
from robot_offload_core.relay.goals.state import Command, Event, Why
from robot_offload_core.relay.goals.wire_ids import goal_id_of, with_goal_id
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
from robot_offload_core.relay.post import Post
from robot_offload_core.relay.process import MAX_PAYLOAD, STATUS_S, RelayPlan, RelayProcess, status_problems
from robot_offload_core.relay.robot_requests import RobotRequests
from robot_offload_core.relay.robot_used import RobotUsed
from robot_offload_core.words.messages import Letters, RelayOrders, RelayStatus
from robot_offload_core.words.replace import replace
from robot_offload_core.words.veil import unveil_token

HOLDER_LOOK_S = 0.02
"""How often the holder is read while anything is open: the collector's memory wakes no process."""
GOALS_PENDING = "GoalsPending"
DIVERGED = "Diverged"


class RobotRelay(RelayProcess):
    """The robot's relay: takes the clients' goals and calls, and has either side execute them.

    Attributes:
        ledger: of goals.
        requests: of services.
        own: attempts at the robot's replica.
        orders: of control.
        dirty: something other than feedback arrived or changed since the last turn, so a look is needed.
        turn_due_s: when a look is needed otherwise.
        fed: newest feedback passed, by attempt.
    """

    def __init__(
        self, plan: RelayPlan, ports: RobotRelayPorts, incarnation: str, records: Iterable[bytes] = ()
    ) -> None:
        self.plan = plan
        self.ports = ports
        self.post = Post(incarnation, ports)
        self.own = Executor(Face.GROUP, ports, self._outcome)
        self.orders: RelayOrders | None = None
        self.up: frozenset[tuple[Site, str]] = frozenset()
        self.services: dict[str, str] = {}
        self.fed: dict[bytes, int] = {}
        self.counters: Counter[str] = Counter()
        self.requests = RobotRequests(plan, ports, self.post, self.view, self._keep, self.counters)
        self.used = RobotUsed(plan, ports, self.post, self.view, self._keep, self.counters)
        self.status: RelayStatus | None = None
        self.status_due_s = self.look_due_s = ports.now_s()
        self.queue: deque[Event] = deque()
        self.running, self.dirty, self.turn_due_s = False, False, ports.now_s()
        self._of = {s.name: s.node for s in plan.services} | {a.name: a.node for a in plan.actions}
        holding = ports.holder()
        self.ledger = machine.start(
            incarnation, plan.actions, holding, plan.prepare_deadline_s, plan.cancel_deadline_s
        )  # fmt: skip
        self._succeed(list(records))

    def _succeed(self, records: list[bytes]) -> None:
        """Continue where a predecessor ended, with its goals and waiting clients; its open calls fail."""
        said = journal.replay(records)
        self.counters["journal.dropped"] += said.dropped
        self.ledger = journal.restored(self.ledger, said)
        self.requests.fail_open(said.calls)
        self.used.succeed(said)
        if records:
            self.ports.compact(self._whole())
            self.step(state.Replaced())

    # -- the machines -------------------------------------------------------------------------------------------------

    def view(self) -> state.View:
        """Return the present view: the holder is read from the collector's memory, the rest is as last reported."""
        orders = self.orders
        candidate = orders.candidate if orders is not None else None
        able = frozenset(orders.able) if orders is not None else frozenset()
        present = presence(orders.robot, orders.cloud) if orders is not None and orders.cloud else None
        standby = (
            Token(orders.robot, orders.epoch, orders.cloud) if present is not None and orders is not None else None
        )
        return state.View(self.ports.holder(), candidate, able, self.up, self.post.heard(), present, standby)

    def step(self, event: Event) -> None:
        """Step the ledger; process at once the events that its commands cause."""
        self.queue.append(event)
        if self.running:
            return
        self.running = True
        try:
            while self.queue:
                self._step(self.queue.popleft())
        finally:
            self.running = False

    def _step(self, event: Event) -> None:
        before = self.ledger
        after, commands = machine.step(before, event, self.view(), self.ports.now_s())
        kept = True
        for record in journal.changes(before, after):
            kept = self._keep(record) and kept
        if not kept and isinstance(event, state.GoalRequested):
            self.counters[f"{event.action}.{Why.JOURNAL_FULL.value}"] += 1
            self.ports.answer_goal(Face.PUBLIC, event.action, event.caller, False, 0)
            return
        self.dirty |= after.goals is not before.goals or after.holding != before.holding
        self.ledger = after
        for command in commands:
            self._carry_out(command)

    def _keep(self, record: bytes) -> bool:
        """Append to the journal; if it is full, rewrite it with the fewest records."""
        if self.ports.keep(record):
            return True
        self.counters["journal.compacted"] += 1
        return self.ports.compact(self._whole()) and self.ports.keep(record)

    def _whole(self) -> list[bytes]:
        return journal.whole(self.ledger, self.requests.calls) + self.used.records()

    def _carry_out(self, command: Command) -> None:
        ports = self.ports
        match command:
            case state.AnswerGoal():
                if command.why is not None:
                    self.counters[f"{command.action}.{command.why.value}"] += 1
                ports.answer_goal(Face.PUBLIC, command.action, command.caller, command.accepted, command.stamp_ns)
            case state.AnswerCancel():
                ports.answer_cancel(Face.PUBLIC, command.action, command.caller, command.code, command.goals)
            case state.AnswerResult():
                ports.answer_result(Face.PUBLIC, command.action, command.caller, command.status, command.payload)
            case state.PublishStatus():
                ports.publish_status(Face.PUBLIC, command.action, command.goals)
            case state.GoalClosed():
                self.counters[f"{command.action}.{command.status.name.lower()}"] += 1
                if command.why is not None:
                    self.counters[f"{command.action}.{command.why.value}"] += 1
            case state.Offer() | state.Cancel() | state.Resume():
                self._to_side(command)

    def _to_side(self, command: state.Offer | state.Cancel | state.Resume) -> None:
        face, action, attempt = Face.GROUP, command.action, command.attempt
        local = command.site is Site.ROBOT
        if isinstance(command, state.Offer) and not command.mirror:
            self.counters[f"{action}.resent"] += questions.is_resent(self.ledger, attempt)
        match command:
            case state.Offer() if local:
                self.own.offer(action, attempt, command.payload, command.token)
            case state.Offer():
                payload = with_goal_id(command.payload, attempt)
                self.post.write(OfferWord(face, action, attempt, command.token, command.mirror, payload))
            case state.Cancel() if local:
                self.own.cancel(attempt)
            case state.Cancel():
                self.post.write(CancelWord(face, action, attempt))
            case state.Resume() if local:
                self.own.resume(action, attempt, command.token)
            case state.Resume():
                self.post.write(ResumeWord(face, action, attempt, command.token, command.mirror))

    def _outcome(self, outcome: Outcome) -> None:
        match outcome:
            case OfferAnswered():
                answer = state.OfferAnswer.ACCEPTED if outcome.accepted else state.OfferAnswer.REFUSED
                self.step(state.OfferAnswered(outcome.attempt, answer))
            case RunEnded():
                self.step(state.Ended(outcome.attempt, outcome.status, outcome.result))
            case RunGone():
                self.step(state.Gone(outcome.attempt))

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
        dirty, self.dirty = self.dirty, False
        self.own.turn()
        self.used.out.turn()
        self._look(now_s)
        self.post.turn(self._hello())
        if dirty or self.dirty or now_s >= self.status_due_s:
            self._report(now_s)
        parts = (self.post, self.own, self.requests, self.used)
        self.turn_due_s = min(self.status_due_s, self.look_due_s, *(part.due_s() for part in parts))

    def _look(self, now_s: float) -> None:
        """Check the holder and deadlines: often while anything is open."""
        self.step(state.Looked())
        self.requests.settle()
        self.used.settle()
        live = any(goal.ended_s is None for goal in self.ledger.goals.values())
        idle = self.requests.idle() and self.used.idle() and not live
        self.look_due_s = now_s + (STATUS_S if idle else HOLDER_LOOK_S)
        self.fed = {attempt: n for attempt, n in self.fed.items() if attempt in self.ledger.index}

    def handle(self, message: object) -> None:
        """Take control's orders and the cloud relay's words."""
        if isinstance(message, RelayOrders):
            self.dirty = True
            self.orders = self.requests.orders = self.used.orders = message
            self.post.agent = message.cloud
            self._see()
            self._look(self.ports.now_s())
        elif isinstance(message, Letters):
            word, met = self.post.take(message.data)
            self.dirty |= not isinstance(word, FeedbackWord)
            if met:
                self.counters["relay.met"] += 1
                self.requests.desk.lost(Site.CLOUD)
                self.step(state.Replaced(Site.CLOUD))
                self.used.cloud_relay_met()
            if isinstance(word, CallWord | OfferWord | ResumeWord) and self.orders is not None:
                word = replace(word, token=unveil_token(word.token, self.orders.robot))
            if word is not None:
                self._take(word)

    def servers_seen(self, servers: Iterable[tuple[Face, str, str]]) -> None:
        """Take the servers in the graph."""
        self.dirty, servers = True, list(servers)
        self.used.servers_seen(servers)
        seen = {name: endpoints for face, name, endpoints in servers if face is Face.GROUP}
        before, self.services = self.services, seen
        for name in self.requests.desk.services:
            if name in before and seen.get(name) != before[name]:
                self.requests.desk.lost_server(Site.ROBOT, name)
        self._see()
        self.own.servers_seen({name: endpoints for name, endpoints in seen.items() if name in self.ledger.actions})

    def _see(self) -> None:
        """Compute which servers are up: seen, and their nodes Active; the cloud's as its relay reports."""
        active = self.orders.active if self.orders is not None else ()
        ours = {(Site.ROBOT, name) for name in self.services if not self._of.get(name) or self._of[name] in active}
        theirs = {(Site.CLOUD, name) for name in self.post.hello.up} if self.post.hello is not None else set()
        self.up = frozenset(ours | theirs)

    # -- the cloud's words --------------------------------------------------------------------------------------------

    def _take(self, word: Word) -> None:
        match word:
            case Hello():
                self._see()
                self._look(self.ports.now_s())
            case OfferedWord():
                answers = {
                    CallVerdict.DONE: state.OfferAnswer.ACCEPTED,
                    CallVerdict.NOT_HOLDER: state.OfferAnswer.NOT_HOLDER,
                }
                self.step(state.OfferAnswered(word.attempt, answers.get(word.verdict, state.OfferAnswer.REFUSED)))
            case EndedWord():
                self.step(state.Ended(word.attempt, word.status, word.payload, word.under_lease))
            case CalledWord():
                self.requests.take(word)
            case FeedbackWord():
                self._feedback(word.action, word.payload, word.sequence)
            case CallWord():
                self.used.called_in_cloud(word)
            case OfferWord() | CancelWord() | ResumeWord():
                self.used.take(word)
            case _:
                pass

    def _feedback(self, action: str, payload: bytes, sequence: int) -> None:
        """Pass feedback of the holder's copy, in order, under the client's id (rule 5)."""
        attempt = goal_id_of(payload)
        if attempt is None or sequence <= self.fed.get(attempt, 0):
            return
        goal = questions.passes_feedback(self.ledger, attempt, self.view())
        if goal is None or goal.action != action:
            self.counters[f"{action}.feedback_left_out"] += 1
            return
        self.fed[attempt] = sequence
        self.ports.publish_feedback(Face.PUBLIC, action, with_goal_id(payload, goal.id))

    # -- servers here -------------------------------------------------------------------------------------------------

    def offer_answered(self, face: Face, name: str, goal_id: bytes, accepted: bool) -> None:
        """Take the answer to an offer."""
        self.dirty = True
        self._at(face).offer_answered(goal_id, accepted)

    def cancel_answered(self, face: Face, name: str, goal_id: bytes, code: CancelCode) -> None:
        """Take the answer to a cancel."""
        self.dirty = True
        self._at(face).cancel_answered(goal_id, code)

    def result_arrived(self, face: Face, name: str, goal_id: bytes, status: GoalStatus, payload: bytes) -> None:
        """Take a result."""
        self.dirty = True
        if len(payload) > MAX_PAYLOAD:
            self.counters[f"{name}.too_large"] += 1
            payload = b""
        self._at(face).result_arrived(goal_id, status, payload)

    def feedback_arrived(self, face: Face, name: str, payload: bytes) -> None:
        """Take feedback of the robot's replica, or of a server outside the group."""
        if face is Face.PUBLIC:
            self.used.feedback_arrived(name, payload)
            return
        attempt = goal_id_of(payload)
        sequence = self.own.feedback_arrived(attempt) if attempt is not None else 0
        if sequence:
            self._feedback(name, payload, sequence)

    def call_answered(self, key: int, payload: bytes, success: bool = True) -> None:
        """Take the answer of a served service, or of a used one (keys of used ones are negative)."""
        self.dirty = True
        (self.requests if key > 0 else self.used).answered(key, payload, success)

    def _at(self, face: Face) -> Executor:
        return self.own if face is Face.GROUP else self.used.out

    # -- clients ------------------------------------------------------------------------------------------------------

    def goal_requested(self, face: Face, name: str, caller: bytes, payload: bytes) -> None:
        """Take a goal: of a client at a served action, or of the robot's group at a used one."""
        self.dirty, goal_id = True, goal_id_of(payload)
        if face is Face.GROUP:
            self.used.goal_requested(name, caller, payload)
        elif goal_id is None or len(payload) > MAX_PAYLOAD:
            self.counters[f"{name}.{Why.TOO_LARGE.value}"] += 1
            self.ports.answer_goal(face, name, caller, False, 0)
        else:
            self.step(state.GoalRequested(name, caller, goal_id, payload, self.ports.wall_ns()))

    def cancel_requested(self, face: Face, name: str, caller: bytes, goal_id: bytes, stamp_ns: int) -> None:
        """Take a client's cancel."""
        self.dirty = True
        asked = state.CancelRequested(name, caller, goal_id, stamp_ns)
        if face is Face.GROUP:
            self.used.cancel_requested(asked)
        else:
            self.step(asked)

    def result_requested(self, face: Face, name: str, caller: bytes, goal_id: bytes) -> None:
        """Take a client's request for a result."""
        self.dirty = True
        if face is Face.GROUP:
            self.used.near.ask_result(name, caller, goal_id)
        else:
            self.step(state.ResultRequested(name, caller, goal_id))

    def called(self, face: Face, name: str, caller: bytes, payload: bytes) -> None:
        """Take a call: of a client at a served service, or of the robot's group at a used one."""
        self.dirty = True
        (self.used if face is Face.GROUP else self.requests).called(name, caller, payload)

    # -- levels -------------------------------------------------------------------------------------------------------

    def _hello(self) -> Hello:
        holding = self.ports.holder()
        agent = self.orders.robot if self.orders is not None else ""
        return Hello(agent, holding.site, holding.stay, (), questions.executing(self.ledger, Site.ROBOT))

    def _pending(self, view: state.View) -> tuple[tuple[str, str], ...]:
        found = []
        lacking, differing = attempts.pending(self.ledger, view), self.requests.desk.diverged(view)
        if lacking:
            found.append((GOALS_PENDING, f"Goals not accepted yet by the side that gets ready: {', '.join(lacking)}"))
        if differing:
            found.append((DIVERGED, f"Calls not executed yet by the side that gets ready: {', '.join(differing)}"))
        return tuple(found)

    def _lacking(self, view: state.View, now_s: float) -> tuple[tuple[str, str], ...]:
        found = []
        waiting, refused = attempts.waiting(self.ledger, view, now_s), self.requests.desk.refused(view)
        if waiting:
            found.append((GOALS_PENDING, f"Goals that no server of the acting side has accepted: {', '.join(waiting)}"))
        if refused:
            found.append((DIVERGED, f"Calls that the acting side has refused: {', '.join(refused)}"))
        return tuple(found)

    def _report(self, now_s: float) -> None:
        view = self.view()
        token = view.candidate[1] if view.candidate is not None else None
        hold, hold_for_s = attempts.held(self.ledger)
        holds = view.holding.site is Site.ROBOT
        waits = (
            not holds
            and self.requests.desk.busy(Site.ROBOT)
            and now_s < self.ledger.changed_s + self.plan.cancel_deadline_s
        )
        busy = waits or questions.busy(self.ledger, Site.ROBOT, now_s)
        executing = questions.executing(self.ledger, Site.ROBOT)
        status = RelayStatus(
            token, self._pending(view), hold, busy, executing, hold_for_s, view.holding.site,
            attempts.unfit(self.ledger, view, now_s), self._lacking(view, now_s),
        )  # fmt: skip
        if status == self.status and now_s < self.status_due_s:
            return
        self.status, self.status_due_s = status, now_s + STATUS_S
        for process in ("control", "collector"):
            self.ports.send(process, status_problems(status, self.post, self.counters, self._levels(view)))

    def _levels(self, view: state.View) -> dict[str, int]:
        """Return how many goals and calls are open, for diagnostics: of each action and service, and in total."""
        by_action = questions.open_goals(self.ledger, view)
        calls = Counter(request.spec.name for request in self.requests.desk.requests)
        return {
            **{f"{action}.running": running for action, (running, _) in by_action.items()},
            **{f"{action}.waiting": waiting for action, (_, waiting) in by_action.items()},
            **{f"{service.name}.open": calls[service.name] for service in self.plan.services},
            "open.goals_running": sum(running for running, _ in by_action.values()),
            "open.goals_waiting": sum(waiting for _, waiting in by_action.values()),
            "open.calls": calls.total(),
            "open.used_goals": len(self.used.goals.goals),
            "open.used_calls": len(self.used.calls.calls),
        }
